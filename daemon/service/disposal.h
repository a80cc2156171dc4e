/* SPDX-License-Identifier: Apache-2.0 */
/*
 * disposal.h - frees canonical copies that are no longer needed, and then ends the memory promises of their prepares
 * (admission.h).
 *
 * Freeing a large copy takes milliseconds, in which the loop would stop for all clients, so a worker does it. For the
 * loop thread only.
 */
#ifndef BVHD_DISPOSAL_H
#define BVHD_DISPOSAL_H

#include "daemon/pool/pool.h"
#include "daemon/service/admission.h"
#include "daemon/service/preparation.h"

struct disposals {
    struct pool *pool;
    struct pool_flow *flow; /* the scheduler's account for jobs that free memory */
    struct memory *memory; /* for the jobs */
    struct admission *admission;
    uint32_t running; /* copies that are with a worker */
};

/*
 * Takes over a preparation and frees it: a small one at once, a large one by a job. Its promise ends when it has been
 * freed. The call never fails: without memory for a job, it frees the preparation at once. `preparation` may be NULL.
 */
void disposals_add(struct disposals *disposals, struct preparation *preparation);

#endif
