/* SPDX-License-Identifier: Apache-2.0 */
/* local.h - what a command needs that computes in this process: threads, a memory budget, a line of progress. */
#ifndef BVHCTL_LOCAL_H
#define BVHCTL_LOCAL_H

#include "proto/base/memory.h"
#include "client/bvhctl/base/progress.h"
#include "builder/workers.h"

struct local {
    struct memory memory;
    struct workers *workers;
    const struct parallel *parallel; /* the workers */
    struct progress progress;
};

/* `threads` 0: one for each processor. End with local_close. */
enum bvhd_status local_open(struct local *local, uint32_t threads, uint64_t memory_limit, struct bvhd_error *error);
void local_close(struct local *local);

#endif
