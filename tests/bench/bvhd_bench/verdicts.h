/* SPDX-License-Identifier: Apache-2.0 */
/* verdicts.h - counts how often a subject is wrong, by comparison with brute force in double. */
#ifndef BVHD_BENCH_VERDICTS_H
#define BVHD_BENCH_VERDICTS_H

#include "client/bvhctl/oracle/oracle.h"
#include "tests/bench/bvhd_bench/subject.h"

/*
 * Rays, and what they should hit. Half of them are chosen as `bvhctl check` chooses them; the other half are aimed from
 * outside at corners and edges of random triangles, where traversals that are not watertight miss.
 */
struct trial {
    uint32_t count;
    struct ray *rays; /* malloc */
    struct oracle_answer *answers; /* malloc */
    struct memory *memory;
};

struct verdicts {
    uint64_t rays, hits, uncertain;
    uint64_t wrong_miss, wrong_hit, wrong_primitive;
    /* hits of the right triangle at a distance that it cannot have, even when all inputs move by one ulp */
    uint64_t inexact;
    double t_rel_err_max;
};

/* Makes rays from `seed` and traces them by brute force. The caller ends the trial with trial_finish. */
struct trial trial_make(struct bench *bench, const struct ply *mesh, uint64_t seed, uint32_t rays);
void trial_finish(struct trial *trial);

struct verdicts verdicts_of(const struct trial *trial, const struct subject *subject);
/* The sum of wrong misses, wrong hits and wrong primitives. */
uint64_t verdicts_wrong(const struct verdicts *verdicts);

#endif
