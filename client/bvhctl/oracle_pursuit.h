/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_pursuit.h - what one ray has met so far, and what follows from it.
 *
 * Kept are the sure hits that may still be the closest, and the triangles that leave a doubt at one edge only: two of them on both sides of an
 * edge that they share make a sure hit of one of the two, so a ray at the inner edges of a mesh is certain and shows its leaks.
 */
#ifndef BVHD_ORACLE_PURSUIT_H
#define BVHD_ORACLE_PURSUIT_H

#include "oracle.h"
#include "oracle_triangle.h"

struct oracle_contender {
    struct oracle_crossing crossing;
    struct oracle_triangle_id id;
};

/* A triangle that is hit if the ray passes on its side of the edge. */
struct oracle_doubt {
    struct oracle_contender contender;
    double edge[2][3]; /* its ends, in the order of the winding */
};

struct oracle_pursuit {
    struct oracle_ray ray;
    enum oracle_ray_kind kind;
    double best_high; /* no sure hit beyond it can be the closest */
    double doubt_low; /* from where on triangles are possible that no neighbour makes up for */
    struct oracle_contender *contenders;
    uint32_t count, capacity;
    struct oracle_doubt *doubts;
    uint32_t doubt_count;
};

void oracle_pursuit_init(struct oracle_pursuit *ret_pursuit, const struct ray *ray);
void oracle_pursuit_finish(struct oracle_pursuit *pursuit, struct memory *memory);

/* False when there is no memory. */
bool oracle_pursuit_meet(struct oracle_pursuit *pursuit, const struct oracle_triangle *triangle, const struct oracle_triangle_id *id,
                         struct memory *memory);

/* The answer after the last triangle. False when there is no memory for the tied triangles. */
bool oracle_pursuit_answer(struct oracle_pursuit *pursuit, struct memory *memory, struct oracle_answer *ret_answer);

#endif
