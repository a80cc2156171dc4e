/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_pursuit.h - collects the primitives that one ray meets, and derives the oracle's answer from them.
 *
 * It keeps the sure hits that may still be the closest, and the possible hits whose doubt is about their edges alone,
 * because oracle_patch.h may remove that doubt with the help of their neighbours.
 */
#ifndef BVHD_ORACLE_PURSUIT_H
#define BVHD_ORACLE_PURSUIT_H

#include "client/bvhctl/oracle/oracle.h"
#include "client/bvhctl/oracle/oracle_patch.h"

struct oracle_contender {
    struct oracle_crossing crossing;
    struct oracle_primitive_id id;
};

/* Open triangles that may be hit. */
struct oracle_doubts {
    uint32_t count;
    struct oracle_contender contenders[ORACLE_PATCH_MAX];
    struct oracle_patch_triangle triangles[ORACLE_PATCH_MAX];
};

struct oracle_pursuit {
    struct oracle_ray ray;
    enum oracle_ray_kind kind;
    double best_high; /* no sure hit beyond it can be the closest */
    double doubt_low; /* the smallest t of a possible hit that no neighbour can make certain */
    struct oracle_contender *contenders; /* sure hits that may be the closest */
    uint32_t count, capacity;
    struct oracle_doubts *doubts; /* NULL: none */
};

void oracle_pursuit_init(struct oracle_pursuit *ret_pursuit, const struct ray *ray);
void oracle_pursuit_finish(struct oracle_pursuit *pursuit, struct memory *memory);

/*
 * Takes note of a hit that is not ABSENT. `outline` is read for a POSSIBLE one only. Returns false when there is no
 * memory.
 */
bool oracle_pursuit_note(struct oracle_pursuit *pursuit, enum oracle_presence presence,
                         const struct oracle_contender *next, const struct oracle_outline *outline,
                         struct memory *memory);

/* Gives the answer after the last primitive. Returns false when there is no memory for the tied ones. */
bool oracle_pursuit_answer(struct oracle_pursuit *pursuit, struct memory *memory, struct oracle_answer *ret_answer);

#endif
