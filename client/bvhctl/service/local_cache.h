/* SPDX-License-Identifier: Apache-2.0 */
/*
 * local_cache.h - the cache on disk, for builds in this process: it has the entries of the user's private daemons.
 *
 * A hit is read and checked before the build would begin. What was built is written when local_cache_close is called,
 * after the command's own files, by all threads at once, since each entry waits for the disk; until then it is copied,
 * as long as the copies are not more than LOCAL_CACHE_PENDING bytes together.
 */
#ifndef BVHCTL_LOCAL_CACHE_H
#define BVHCTL_LOCAL_CACHE_H

#include "client/bvhctl/base/options.h"
#include "proto/base/memory.h"
#include "proto/base/parallel.h"

enum { LOCAL_CACHE_PENDING = 256 << 20 };

struct batch_cache;
struct local_cache;

/*
 * Opens the cache that cache_place_find finds. *ret_cache is NULL if it finds none, and if a directory that --cache did
 * not name cannot be used, which --verbose says. Otherwise BVHD_INVALID, BVHD_IO or BVHD_NO_MEMORY. `parallel` must
 * outlive the cache. What it allocates has no limit. End with local_cache_close.
 */
enum bvhd_status local_cache_open(const struct options *options, const struct parallel *parallel,
                                  struct local_cache **ret_cache, struct bvhd_error *error);

/* Returns the cache for batch_run; NULL for NULL. */
struct batch_cache *local_cache_of(struct local_cache *cache);

/* Writes what is pending, and says when results were damaged or could not be written. NULL is allowed. */
void local_cache_close(struct local_cache *cache);

#endif
