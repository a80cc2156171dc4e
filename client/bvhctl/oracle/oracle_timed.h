/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_timed.h - brute force for as many rays as a limit of time allows, and what it will cost.
 */
#ifndef BVHD_ORACLE_TIMED_H
#define BVHD_ORACLE_TIMED_H

#include "client/bvhctl/oracle/oracle.h"

/* The arguments of oracle_trace, except for its rays. */
struct oracle_work {
    const struct oracle_mesh *meshes;
    uint32_t mesh_count;
    struct memory *memory;
    const struct parallel *parallel;
    /* That of oracle_trace, over all rays; may be NULL. */
    void (*progress)(void *context, uint64_t done, uint64_t total);
    void *progress_context;
};

/* Returns the number of pairs of a ray and a primitive, each of which is a test. */
uint64_t oracle_work_tests(const struct oracle_work *work, uint32_t ray_count);

/* Returns about how many seconds oracle_trace takes, by the rate of a processor of the year 2020. */
double oracle_work_seconds(const struct oracle_work *work, uint32_t ray_count);

/*
 * Traces rays[0 .. *ret_count) as oracle_trace does: at least one of them, and no more after about `seconds`, which may
 * be INFINITY. ret_answers has room for all `ray_count`; those after *ret_count are misses. End with oracle_finish,
 * except after a failure.
 */
enum bvhd_status oracle_trace_timed(const struct oracle_work *work, const struct ray *rays, uint32_t ray_count,
                                    double seconds, struct oracle_answer *ret_answers, uint32_t *ret_count,
                                    struct bvhd_error *error);

#endif
