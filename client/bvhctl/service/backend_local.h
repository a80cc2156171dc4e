/* SPDX-License-Identifier: Apache-2.0 */
/*
 * backend_local.h - builds and updates structures in this process, by the same steps as the service. The sources of
 * updates are the results that were not released yet, and those of the cache on disk, which has no results of updates.
 */
#ifndef BVHCTL_BACKEND_LOCAL_H
#define BVHCTL_BACKEND_LOCAL_H

#include "builder/update/batch.h"
#include "client/bvhctl/base/progress.h"
#include "client/bvhctl/service/backend.h"

struct hold;
struct local_cache;
struct options;
struct workers;

struct backend_local {
    struct backend backend;
    struct build_context context;
    struct workers *workers;
    struct local_cache *cache; /* NULL: every result is built */
    struct batch_held held;
    struct hold *holds; /* the results that were not released yet */
};

/*
 * With `threads` 0 there is one thread for each processor. All allocations come from `memory`; the progress of builds
 * is drawn by `progress`. Both must outlive the backend. End with backend_local_close; the struct must not be moved.
 */
enum bvhd_status backend_local_open(struct backend_local *local, uint32_t threads, struct memory *memory,
                                    struct progress *progress, struct bvhd_error *error);

/* Takes results from the cache on disk that `options` name, and keeps them there. Errors: see local_cache_open. */
enum bvhd_status backend_local_use_cache(struct backend_local *local, const struct options *options,
                                         struct bvhd_error *error);

/* Writes what the cache is to keep. All results must have been released before. A zeroed struct is allowed. */
void backend_local_close(struct backend_local *local);

#endif
