/* SPDX-License-Identifier: Apache-2.0 */
/* local.h - threads, a memory budget and a progress line, for commands that compute in this process. */
#ifndef BVHCTL_LOCAL_H
#define BVHCTL_LOCAL_H

#include "proto/base/memory.h"
#include "client/bvhctl/base/progress.h"
#include "proto/base/parallel.h"
#include "proto/base/status.h"

struct workers;

struct local {
    struct memory memory;
    struct workers *workers;
    const struct parallel *parallel; /* the workers */
    struct progress progress;
};

/* With `threads` 0 there is one thread for each processor. End with local_close; the struct must not be moved. */
enum bvhd_status local_open(struct local *local, uint32_t threads, uint64_t memory_limit, struct bvhd_error *error);
void local_close(struct local *local);

#endif
