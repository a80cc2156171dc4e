/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_pursuit.h - what one ray has met so far, and what follows from it.
 *
 * Kept are the sure hits that may still be the closest, and the triangles whose edges leave a doubt, which their
 * neighbours may settle.
 */
#ifndef BVHD_ORACLE_PURSUIT_H
#define BVHD_ORACLE_PURSUIT_H

#include "client/bvhctl/oracle/oracle.h"
#include "client/bvhctl/oracle/oracle_patch.h"

struct oracle_contender {
    struct oracle_crossing crossing;
    struct oracle_triangle_id id;
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
    double doubt_low; /* from where on triangles are possible that no neighbour settles */
    struct oracle_contender *contenders;
    uint32_t count, capacity;
    struct oracle_doubts *doubts; /* NULL: none */
};

void oracle_pursuit_init(struct oracle_pursuit *ret_pursuit, const struct ray *ray);
void oracle_pursuit_finish(struct oracle_pursuit *pursuit, struct memory *memory);

/* False when there is no memory. */
bool oracle_pursuit_meet(struct oracle_pursuit *pursuit, const struct oracle_triangle *triangle,
                         const struct oracle_triangle_id *id, struct memory *memory);

/* The answer after the last triangle. False when there is no memory for the tied triangles. */
bool oracle_pursuit_answer(struct oracle_pursuit *pursuit, struct memory *memory, struct oracle_answer *ret_answer);

#endif
