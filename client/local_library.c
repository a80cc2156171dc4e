/* SPDX-License-Identifier: Apache-2.0 */
#include "client/local_library.h"

#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <link.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <bvhd/bvhd.h>

#include "proto/base/status.h"

/* Writes the path beside libbvhd; false where this code is part of the program, or the path is not absolute. */
static bool find_beside(char ret_path[PATH_MAX])
{
    static const char own_data = 0;
    Dl_info info;
    struct link_map *map;
    if (!dladdr1(&own_data, &info, (void **)&map, RTLD_DL_LINKMAP) || map->l_name[0] != '/')
        return false;
    int length = (int)(strrchr(map->l_name, '/') - map->l_name);
    int size = snprintf(ret_path, PATH_MAX, "%.*s/%s", length, map->l_name, BUILD_LIBRARY_FILE);
    return size > 0 && size < PATH_MAX;
}

/* The messages of dlerror begin with the file's name. */
static const char *last_reason(void)
{
    const char *reason = dlerror();
    return reason ? reason : "dlopen fails";
}

/* Loads the file beside libbvhd. Without it, writes the reason, without the path. */
static void *open_beside(const char *path, char *reason, size_t size)
{
    void *handle = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!handle)
        snprintf(reason, size, "%s; nor ", access(path, F_OK) == 0 ? last_reason() : strerror(errno));
    return handle;
}

static void *open_library(struct bvhd_error *error)
{
    char path[PATH_MAX] = BUILD_LIBRARY_FILE, reason[sizeof error->text] = "";
    void *handle = find_beside(path) ? open_beside(path, reason, sizeof reason) : NULL;
    if (!handle)
        handle = dlopen(BUILD_LIBRARY_FILE, RTLD_NOW | RTLD_LOCAL);
    if (!handle)
        bvhd_error_set(error, BVHD_UNSUPPORTED, path, "cannot be loaded to build in this process: %s%s", reason,
                       last_reason());
    return handle;
}

/* The name of the entry and the first field of the table are the same in all versions. */
static enum bvhd_status check_version(void *handle, const struct build_library **ret_library, struct bvhd_error *error)
{
    const struct build_library *(*entry)(void);
    *(void **)&entry = dlsym(handle, BUILD_LIBRARY_ENTRY);
    if (!entry)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, BUILD_LIBRARY_FILE, "has no function %s", BUILD_LIBRARY_ENTRY);
    const struct build_library *library = entry();
    if (strcmp(library->version, BVHD_VERSION_STRING) != 0)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, BUILD_LIBRARY_FILE, "has version %.32s, but libbvhd %s",
                              library->version, BVHD_VERSION_STRING);
    *ret_library = library;
    return BVHD_OK;
}

static enum bvhd_status load(const struct build_library **ret_library, struct bvhd_error *error)
{
    void *handle = open_library(error);
    if (!handle)
        return BVHD_UNSUPPORTED;
    enum bvhd_status status = check_version(handle, ret_library, error);
    if (status != BVHD_OK)
        dlclose(handle);
    return status;
}

enum bvhd_status local_library_load(const struct build_library **ret_library, struct bvhd_error *error)
{
    static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    static const struct build_library *loaded;
    enum bvhd_status status = BVHD_OK;
    pthread_mutex_lock(&lock);
    if (!loaded)
        status = load(&loaded, error);
    if (status == BVHD_OK)
        *ret_library = loaded;
    pthread_mutex_unlock(&lock);
    return status;
}
