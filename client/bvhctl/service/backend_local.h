/* SPDX-License-Identifier: Apache-2.0 */
/* backend_local.h - building in this process: from Vulkan's structs to results, as the service goes. */
#ifndef BVHCTL_BACKEND_LOCAL_H
#define BVHCTL_BACKEND_LOCAL_H

#include "client/bvhctl/service/backend.h"
#include "builder/context.h"
#include "builder/workers.h"

struct backend_local {
    struct backend backend;
    struct build_context context;
    struct workers *workers;
};

/*
 * `threads` 0: one for each processor. Everything comes from `memory`, which must outlive it like `progress`, which it
 * draws. `cancel` may be NULL. End with backend_local_close; the struct must not move.
 */
enum bvhd_status backend_local_open(struct backend_local *local, uint32_t threads, struct memory *memory,
                                    struct progress *progress, const atomic_bool *cancel, struct bvhd_error *error);

/* All results must be released. NULL-safe for a zeroed struct. */
void backend_local_close(struct backend_local *local);

#endif
