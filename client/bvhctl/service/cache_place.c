/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/cache_place.h"

#include <stdlib.h>

#include "client/bvhctl/base/files.h"

/* A variable that names no absolute path is to be passed over, by the XDG base directory specification. */
static const char *absolute(const char *variable)
{
    const char *path = getenv(variable);
    return path && *path == '/' ? path : NULL;
}

enum bvhd_status cache_place_find(const struct options *options, struct memory *memory, char **ret_directory,
                                  struct bvhd_error *error)
{
    const char *named = options->cache ? options->cache : getenv("BVHD_CACHE");
    const char *caches = absolute("XDG_CACHE_HOME"), *home = absolute("HOME");
    char *directory;
    if (home && !files_is_directory(home))
        home = NULL; /* machines that build packages have homes that do not exist, and must not get them */
    if (options->no_cache || (named && !*named) || (!named && !caches && !home)) {
        *ret_directory = NULL;
        return BVHD_OK;
    }
    if (named)
        directory = files_copy_text(memory, named);
    else
        directory = files_join(memory, caches ? caches : home, caches ? "bvhd" : ".cache/bvhd");
    if (!directory)
        return bvhd_error_no_memory(error, "cache", "no memory for the name of its directory");
    *ret_directory = directory;
    return BVHD_OK;
}
