/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd.h - acceleration structures built by a service: the client library.
 *
 * A program describes what it wants in Vulkan's own structs, with host addresses, and gets serialized acceleration
 * structures. The service does equal work once, so asking again is cheap; and whoever has kept a key gets the bytes
 * without sending geometry.
 *
 *     struct bvhd_client *client;
 *     bvhd_client_create(NULL, &client, &error);
 *     bvhd_batch_submit(client, &build, &batch, &error);
 *     bvhd_batch_wait(batch, -1);
 *     const struct bvhd_result *result = bvhd_batch_result(batch, 0);     result->error.status, result->data, result->size, result->key
 *     bvhd_batch_destroy(batch);
 *     bvhd_client_destroy(client);
 *
 * Threads: every function may be called from any thread, on any object, at any time, with one exception: the one that
 * ends an object must be the last call on it. Several threads may wait at once. The library starts no threads: work
 * moves on inside of its calls (wait, dispatch, submit, ...), and nowhere else. No function but those named "wait",
 * "connect", "ping" and "counters" blocks; but geometry is copied inside of submit, dispatch and wait, which takes its
 * time.
 *
 * Errors: a status, and in *ret_error (may be NULL) the rule and the place. Functions that fail leave their results
 * untouched and hold nothing.
 *
 * A daemon that is gone: when its process ends, the socket says so, and everything under way fails with
 * BVHD_UNAVAILABLE at the next call, or at once for who waits or watches bvhd_client_descriptor. A daemon that is there
 * but says nothing at all while it owes an answer is given up after `lost_after_ms`. A submission without a daemon
 * fails after `connect_timeout_ms`. The next submission after a loss connects anew, so a restarted daemon is found. A
 * daemon that announces its end finishes what it has; what is submitted from then on goes to the next one. Whoever gets
 * BVHD_UNAVAILABLE can fall back to the device's own build, or submit again. The other way round a daemon gives up a
 * program that leaves what it sends unread for 30 s: whoever asks for much and then does something else for long should
 * dispatch meanwhile.
 *
 * The process may fork; the child must not use the parent's objects. No signal is raised or handled. Descriptors are
 * close-on-exec.
 */
#ifndef BVHD_BVHD_H
#define BVHD_BVHD_H

#include <stddef.h>
#include <stdint.h>

#include <bvhd/status.h>
#include <vulkan/vulkan_core.h>

#ifdef __cplusplus
extern "C" {
#endif

struct bvhd_client;
struct bvhd_batch;
struct bvhd_blob;
struct bvhd_counters;

/* "0.1.0": of the library that runs. */
BVHD_API const char *bvhd_version(void);

/* ---- Keys: the name of immutable bytes. Whoever knows a key may have the bytes: treat it like them. ---- */

enum { BVHD_KEY_SIZE = 32, BVHD_KEY_TEXT_SIZE = 65 };

struct bvhd_key {
    uint8_t bytes[BVHD_KEY_SIZE];
};

/* 64 lower-case hexadecimal digits and a NUL. */
BVHD_API void bvhd_key_to_text(const struct bvhd_key *key, char ret_text[BVHD_KEY_TEXT_SIZE]);

/* BVHD_INVALID when it is not 64 hexadecimal digits. */
BVHD_API enum bvhd_status bvhd_key_from_text(const char *text, struct bvhd_key *ret_key);

/* ---- The client: a connection to the service, made when it is needed. ---- */

struct bvhd_client_options {
    size_t struct_size; /* sizeof(struct bvhd_client_options): it may grow */
    /*
     * Path of the daemon's socket. NULL: $BVHD_SOCKET; without that $XDG_RUNTIME_DIR/bvhd.sock, and where nobody
     * answers there /run/bvhd/bvhd.sock.
     */
    const char *socket_path;
    uint32_t connect_timeout_ms; /* how long a daemon is looked for; 0: 5,000 */
    uint32_t lost_after_ms; /* silence of a daemon that owes an answer; 0: 10,000 */
    /* bytes of memory shared with the daemon, allocated as needed and then kept; 0: 64 MiB, the most */
    uint64_t pool_size;
};

/* Does not connect yet. `options` may be NULL: all 0. */
BVHD_API enum bvhd_status bvhd_client_create(const struct bvhd_client_options *options, struct bvhd_client **ret_client,
                                             struct bvhd_error *ret_error);

/* Its batches must be destroyed before, and no thread may be in a call; blobs and counters live on. NULL-safe. */
BVHD_API void bvhd_client_destroy(struct bvhd_client *client);

/*
 * Waits until the daemon has answered. Not needed before a submission. BVHD_UNAVAILABLE after `connect_timeout_ms`,
 * BVHD_INCOMPATIBLE.
 */
BVHD_API enum bvhd_status bvhd_client_connect(struct bvhd_client *client, struct bvhd_error *ret_error);

/*
 * A descriptor for event loops, the same for the client's whole life and owned by it: when it is readable, call
 * bvhd_client_dispatch. (It is an epoll descriptor; timeouts and a change of connection are behind it, too.)
 */
BVHD_API int bvhd_client_descriptor(const struct bvhd_client *client);

/* Does what can be done now: sends, receives, notices timeouts. Never blocks. Failures show in the batches. */
BVHD_API void bvhd_client_dispatch(struct bvhd_client *client);

/* ---- Batches: several structures asked for at once; each succeeds or fails alone. ---- */

enum bvhd_quality {
    BVHD_QUALITY_UNSPECIFIED = 0, /* Vulkan's PREFER flags decide: FAST_BUILD fast, FAST_TRACE high, else auto */
    BVHD_QUALITY_FAST = 1,
    BVHD_QUALITY_BALANCED = 2,
    BVHD_QUALITY_HIGH = 3,
    BVHD_QUALITY_AUTO = 4, /* by the geometry and rays_per_primitive; balanced where nothing is said of rays */
};

enum bvhd_target {
    BVHD_TARGET_PORTABLE = 1, /* read by shaders from storage buffers, and on the CPU */
    BVHD_TARGET_LAVAPIPE = 2, /* Mesa's CPU driver, natively; needs bvhd_build.format */
};

/*
 * What a device's driver loads natively: found by a probe (bvhd_vulkan.h, or `bvhctl probe`), given to builds. Plain
 * values: copy, keep and compare them freely.
 */
struct bvhd_format {
    size_t struct_size; /* sizeof(struct bvhd_format) */
    enum bvhd_target target;
    uint32_t variant; /* of the target's layout */
    uint8_t driver_uuid[16]; /* as the driver's own serialized structures begin */
    uint8_t compatibility_uuid[16];
};

/*
 * The format of the device that a probe came from; struct_size is set, too. The probe may come from anywhere, at any
 * alignment. BVHD_UNSUPPORTED: none that this library knows reproduces the probe, so that the device takes the portable
 * target alone. BVHD_CORRUPT: this is no probe. BVHD_INCOMPATIBLE: one of another version.
 */
BVHD_API enum bvhd_status bvhd_format_from_probe(const void *probe, uint64_t size, struct bvhd_format *ret_format,
                                                 struct bvhd_error *ret_error);

/* The name of a target: "portable", "lavapipe"; NULL for a number that is none. */
BVHD_API const char *bvhd_target_name(enum bvhd_target target);

enum {
    BVHD_PORTABLE_FAST_TRIANGLES = 0x1, /* layout_flags: three float4 a triangle instead of shared, indexed vertices */
};

/* Orders the batches of one client; between clients turns are fair. */
enum bvhd_priority { BVHD_PRIORITY_LOW = -1, BVHD_PRIORITY_NORMAL = 0, BVHD_PRIORITY_HIGH = 1 };

/* A structure that instances may name: what a result says of it. */
struct bvhd_reference {
    uint64_t handle; /* the VkAccelerationStructureKHR in the instances, as a number; not 0, unique within the call */
    int has_key;
    struct bvhd_key key;
    float bounds[6]; /* minimum, maximum; an empty structure: result->bounds as they are */
    float slabs[20]; /* result->slabs, with which boxes of instances that are turned become smaller; all 0: not known */
};

struct bvhd_build {
    size_t struct_size; /* sizeof(struct bvhd_build) */
    uint32_t info_count; /* any number, 0 included */
    /* addresses are host addresses; handles are numbers, compared only */
    const VkAccelerationStructureBuildGeometryInfoKHR *infos;
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges; /* ranges[i]: infos[i].geometryCount of them */
    const struct bvhd_reference *references; /* what instances of any info may name */
    uint32_t reference_count;
    enum bvhd_quality quality;
    enum bvhd_target target; /* 0: the format's, without one portable */
    uint32_t layout_flags;
    enum bvhd_priority priority;
    /* what the device loads, of the same target; needed for a native one, NULL for portable */
    const struct bvhd_format *format;
    /*
     * How many rays each structure will meet in its life, for each of its primitives: AUTO then makes building and
     * tracing together take as little as it can. Counted as one thread of a processor traces them: for a device that is
     * a hundred times as fast, say a hundredth. 0: not said; finite and not negative.
     */
    float rays_per_primitive;
    uint32_t reserved; /* 0 */
};

/*
 * Asks for infos[0 .. info_count). Everything the structs point to but geometry memory is copied before this returns.
 * Geometry memory (vertices, indices, boxes, transforms, instances) must stay readable and unchanged until
 * bvhd_batch_is_copied, which for batches that fit into the shared memory is true on return, also without a daemon.
 * Rules that an info breaks are its result's error. A daemon of a version that does not know the target, or that takes
 * no rays_per_primitive but 0 where it would count, says BVHD_UNSUPPORTED in each result. Fails as a whole only for
 * lack of memory (BVHD_NO_MEMORY), or where the struct bvhd_build itself is wrong (BVHD_INVALID).
 */
BVHD_API enum bvhd_status bvhd_batch_submit(struct bvhd_client *client, const struct bvhd_build *build,
                                            struct bvhd_batch **ret_batch, struct bvhd_error *ret_error);

/*
 * Asks for results by key, without geometry. BVHD_NOT_FOUND for a key that the service does not have (any more); one
 * that is being built is waited for.
 */
BVHD_API enum bvhd_status bvhd_batch_fetch(struct bvhd_client *client, uint32_t key_count, const struct bvhd_key *keys,
                                           struct bvhd_batch **ret_batch, struct bvhd_error *ret_error);

BVHD_API uint32_t bvhd_batch_count(const struct bvhd_batch *batch);

/* The caller's geometry memory is not needed any more. Moves on inside of dispatch and wait. */
BVHD_API int bvhd_batch_is_copied(struct bvhd_batch *batch);

/* Every item has its result. */
BVHD_API int bvhd_batch_is_done(struct bvhd_batch *batch);

/*
 * Waits until every item has its result, at most `timeout_ms` (< 0: for ever, which the client's timeouts bound):
 * BVHD_OK or BVHD_PENDING.
 */
BVHD_API enum bvhd_status bvhd_batch_wait(struct bvhd_batch *batch, int timeout_ms);

/* The same, until the geometry memory is free again. */
BVHD_API enum bvhd_status bvhd_batch_wait_copied(struct bvhd_batch *batch, int timeout_ms);

/*
 * Items that have no result yet end with BVHD_CANCELLED, on return; the service stops working on them. Their geometry
 * memory is free.
 */
BVHD_API void bvhd_batch_cancel(struct bvhd_batch *batch);
BVHD_API void bvhd_batch_cancel_item(struct bvhd_batch *batch, uint32_t item);

/*
 * Cancels what is not done; the caller's geometry memory is free. Results end with it, their blobs only when nobody
 * else holds a ref. NULL-safe.
 */
BVHD_API void bvhd_batch_destroy(struct bvhd_batch *batch);

/* Where a result came from. */
enum bvhd_origin {
    BVHD_ORIGIN_NONE = 0,
    BVHD_ORIGIN_BUILT = 1, /* built for this request */
    BVHD_ORIGIN_COALESCED = 2, /* somebody was building the same */
    BVHD_ORIGIN_MEMORY = 3, /* kept from before, in memory */
    BVHD_ORIGIN_DISK = 4, /* kept from before, on disk */
};

struct bvhd_result {
    /*
     * status BVHD_PENDING: not there yet; BVHD_OK: the rest is set; where: as "infos[3].flags", by the call's own count
     */
    struct bvhd_error error;
    struct bvhd_key key;
    /* the serialized acceleration structure: read only, 64-byte aligned, as long as `blob` or the batch lives */
    const void *data;
    uint64_t size;
    struct bvhd_blob *blob; /* the batch's ref */
    enum bvhd_origin origin;
    double queued_ms, prepare_ms, build_ms; /* in the service, for this request */
    /* About the structure; sah and depth are those of the 2-wide tree. */
    uint64_t primitives, triangles, instances, inactive, degenerate, skipped, refs, peak_bytes;
    uint32_t depth;
    double sah;
    double original_build_ms; /* of the build that made the bytes, whoever asked for it */
    const char *method; /* how it was built: "ploc", "spatial", "binned", or "none" without primitives */
    float bounds[6]; /* minimum, maximum: for bvhd_reference */
    float slabs
        [20]; /* minima, maxima along x + y, y + z, z + x, x - y, y - z, z - x, x + y - z, y + z - x, z + x - y, x + y + z: likewise */
    enum bvhd_target target; /* whose format the bytes have */
    enum bvhd_quality quality; /* that was built: FAST, BALANCED or HIGH, whatever was asked */
};

/*
 * An item's result, which lives as long as the batch and never changes. Before the item is done it is another one, with
 * error.status BVHD_PENDING: ask again. NULL when there is no such item.
 */
BVHD_API const struct bvhd_result *bvhd_batch_result(struct bvhd_batch *batch, uint32_t item);

/* ---- Blobs: the bytes, which may outlive batch and client. ---- */

BVHD_API struct bvhd_blob *bvhd_blob_ref(struct bvhd_blob *blob);
BVHD_API void bvhd_blob_unref(struct bvhd_blob *blob);
BVHD_API const void *bvhd_blob_data(const struct bvhd_blob *blob);
BVHD_API uint64_t bvhd_blob_size(const struct bvhd_blob *blob);

/* ---- The service itself. ---- */

/* Waits for an answer. *ret_ms (may be NULL): how long it took, connecting included. BVHD_UNAVAILABLE when none comes within `timeout_ms` (< 0: as long as the
 * client's timeouts take). */
BVHD_API enum bvhd_status bvhd_client_ping(struct bvhd_client *client, int timeout_ms, double *ret_ms,
                                           struct bvhd_error *ret_error);

/* Waits for the service's counters: names and values, in a fixed order. Fails as ping. */
BVHD_API enum bvhd_status bvhd_client_counters(struct bvhd_client *client, int timeout_ms,
                                               struct bvhd_counters **ret_counters, struct bvhd_error *ret_error);
BVHD_API uint32_t bvhd_counters_count(const struct bvhd_counters *counters);
BVHD_API const char *bvhd_counters_name(const struct bvhd_counters *counters, uint32_t index);
BVHD_API uint64_t bvhd_counters_value(const struct bvhd_counters *counters, uint32_t index);
BVHD_API void bvhd_counters_destroy(struct bvhd_counters *counters);

#ifdef __cplusplus
}
#endif

#endif
