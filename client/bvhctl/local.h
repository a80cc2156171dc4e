/* SPDX-License-Identifier: Apache-2.0 */
/* local.h - what building in this process needs: threads, a memory budget, Embree. */
#ifndef BVHCTL_LOCAL_H
#define BVHCTL_LOCAL_H

#include "build.h"
#include "progress.h"
#include "workers.h"

struct local {
    struct memory memory;
    struct workers *workers;
    struct embree *embree;
    struct progress progress;
    struct build_context build; /* for batch_build; draws `progress`; points into this struct, which must not move */
};

/* `threads` 0: one for each processor; `cancel` may be NULL. Without `builds` there is no Embree and build.embree is NULL. End with local_close. */
enum bvhd_status local_open(struct local *local, uint32_t threads, uint64_t memory_limit, bool builds, const atomic_bool *cancel,
                            struct bvhd_error *error);
void local_close(struct local *local);

#endif
