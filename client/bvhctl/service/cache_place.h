/* SPDX-License-Identifier: Apache-2.0 */
/* cache_place.h - where the user's cache on disk is, for builds in this process and for private daemons. */
#ifndef BVHCTL_CACHE_PLACE_H
#define BVHCTL_CACHE_PLACE_H

#include "client/bvhctl/base/options.h"
#include "proto/base/memory.h"

/*
 * Finds the directory: that of --cache, else that of $BVHD_CACHE, else $XDG_CACHE_HOME/bvhd, else ~/.cache/bvhd.
 * *ret_directory is NULL with --no-cache, with an empty $BVHD_CACHE, and for a user who has none of these variables;
 * the caller frees it with memory_free. It need not exist. BVHD_NO_MEMORY.
 */
enum bvhd_status cache_place_find(const struct options *options, struct memory *memory, char **ret_directory,
                                  struct bvhd_error *error);

#endif
