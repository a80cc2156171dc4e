/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/embree_library.h"

#include <dlfcn.h>
#include <pthread.h>
#include <string.h>

#include "builder/piece/embree.h"
#include "proto/base/bytes.h"
#if defined(__SSE__)
#include <xmmintrin.h>
#endif

#if RTC_VERSION_MAJOR == 3
#define LIBRARY_FILE "libembree3.so.3"
#else
#define LIBRARY_FILE "libembree4.so.4"
#endif

/*
 * One thread: parallelism comes from our own threads, over pieces. Without affinity Embree leaves the threads of the
 * program where they are.
 */
#define DEVICE_CONFIG "threads=1,set_affinity=0"

static struct embree_library library;
static struct embree_identity identity;
static struct bvhd_error load_error; /* its status is BVHD_OK if the library has been loaded */
static pthread_once_t load_once = PTHREAD_ONCE_INIT;

static const char *device_config = DEVICE_CONFIG;
static pthread_mutex_t device_lock = PTHREAD_MUTEX_INITIALIZER;
static RTCDevice device;
static unsigned device_users;

/* Where the calling thread counts Embree's memory, and how much of that Embree holds. */
static _Thread_local struct memory *counted_in;
static _Thread_local uint64_t counted;

/* Finds each function by its name; NULL at the first that is missing. */
static const char *find_functions(void *handle)
{
    const struct {
        const char *name;
        void *place;
    } functions[] = {
        {"rtcNewDevice", &library.new_device},
        {"rtcReleaseDevice", &library.release_device},
        {"rtcGetDeviceProperty", &library.get_device_property},
        {"rtcGetDeviceError", &library.get_device_error},
        {"rtcSetDeviceMemoryMonitorFunction", &library.set_memory_monitor},
        {"rtcNewBVH", &library.new_bvh},
        {"rtcReleaseBVH", &library.release_bvh},
        {"rtcBuildBVH", &library.build_bvh},
    };
    for (size_t i = 0; i < sizeof functions / sizeof *functions; i++) {
        void *function = dlsym(handle, functions[i].name);
        if (!function)
            return functions[i].name;
        memcpy(functions[i].place, &function, sizeof function);
    }
    return NULL;
}

/*
 * Digests (FNV-1a) the processor's estimates of the reciprocals of 4096 numbers in [1, 2): more than any known
 * processor distinguishes. Other architectures define theirs exactly.
 */
static uint32_t estimate_digest(void)
{
    uint32_t digest = 2166136261U;
#if defined(__SSE__)
    for (uint32_t i = 0; i < 4096; i++) {
        const uint32_t bits = UINT32_C(0x3f800000) | i << 11;
        float number, estimate;
        uint32_t result;
        memcpy(&number, &bits, sizeof number);
        estimate = _mm_cvtss_f32(_mm_rcp_ss(_mm_set_ss(number)));
        memcpy(&result, &estimate, sizeof result);
        for (int byte = 0; byte < 4; byte++)
            digest = (digest ^ (result >> 8 * byte & 255)) * 16777619U;
    }
#endif
    return digest;
}

static enum bvhd_status refuse(const char *reason, const char *detail)
{
    return bvhd_error_set(&load_error, BVHD_UNSUPPORTED, "build.builder", "Embree cannot be used: %s%s", reason,
                          detail);
}

static enum bvhd_status check_version(void)
{
    RTCDevice probe = library.new_device(DEVICE_CONFIG);
    if (!probe)
        return refuse("it opens no device", "");
    ssize_t version = library.get_device_property(probe, RTC_DEVICE_PROPERTY_VERSION);
    library.release_device(probe);
    identity = (struct embree_identity){(uint32_t)version, estimate_digest()};
    return version / 10000 == RTC_VERSION_MAJOR ? BVHD_OK : refuse(LIBRARY_FILE, " has another version than its name");
}

static void load(void)
{
    void *handle = dlopen(LIBRARY_FILE, RTLD_NOW | RTLD_LOCAL);
    if (!handle) {
        const char *reason = dlerror();
        refuse(reason ? reason : LIBRARY_FILE, "");
        return;
    }
    const char *missing = find_functions(handle);
    if (missing)
        refuse(LIBRARY_FILE " lacks ", missing);
    else
        check_version();
}

const struct embree_library *embree_library(struct bvhd_error *error)
{
    pthread_once(&load_once, load);
    if (load_error.status == BVHD_OK)
        return &library;
    if (error)
        *error = load_error;
    return NULL;
}

enum bvhd_status embree_identify(struct embree_identity *ret_identity, struct bvhd_error *error)
{
    if (!embree_library(error))
        return BVHD_UNSUPPORTED;
    *ret_identity = identity;
    return BVHD_OK;
}

void embree_library_replace_build(void *(*build_bvh)(const struct RTCBuildArguments *arguments))
{
    static void *(*original)(const struct RTCBuildArguments *arguments);
    original = original ? original : library.build_bvh;
    library.build_bvh = build_bvh ? build_bvh : original;
}

void embree_library_configure(const char *config)
{
    device_config = config ? config : DEVICE_CONFIG;
}

void embree_library_count_in(struct memory *memory)
{
    if (counted > 0) /* Embree has said that it would allocate this, and has failed to */
        memory_release(counted_in, counted);
    counted_in = memory;
    counted = 0;
}

/* Embree says what it is about to allocate, and what it has freed. */
static bool count(void *user, ssize_t bytes, bool is_done)
{
    (void)user;
    (void)is_done;
    if (!counted_in || bytes == 0)
        return true;
    if (bytes > 0 && !memory_reserve(counted_in, (uint64_t)bytes))
        return false;
    if (bytes < 0)
        memory_release(counted_in, (uint64_t)-bytes);
    counted += (uint64_t)bytes;
    return true;
}

enum bvhd_status embree_open(struct bvhd_error *error)
{
    const struct embree_library *functions = embree_library(error);
    if (!functions)
        return BVHD_UNSUPPORTED;
    pthread_mutex_lock(&device_lock);
    if (!device && (device = functions->new_device(device_config)))
        functions->set_memory_monitor(device, count, NULL);
    bool is_open = device != NULL;
    device_users += is_open;
    pthread_mutex_unlock(&device_lock);
    return is_open ? BVHD_OK : bvhd_error_no_memory(error, "", "no memory for Embree");
}

void embree_close(void)
{
    pthread_mutex_lock(&device_lock);
    if (--device_users == 0) {
        library.release_device(device);
        device = NULL;
    }
    pthread_mutex_unlock(&device_lock);
}

RTCDevice embree_library_device(void)
{
    return device;
}
