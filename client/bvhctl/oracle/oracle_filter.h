/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_filter.h - the fast first pass of the oracle: finds the primitives of a block that a ray may meet.
 *
 * A pair of a ray and a primitive is dropped when the distance between the ray's line and the centre of the primitive's
 * bounding sphere exceeds the sphere's radius plus all that one-ulp moves of the inputs and rounding could add. A pair
 * is only dropped if the ray surely misses the primitive.
 */
#ifndef BVHD_ORACLE_FILTER_H
#define BVHD_ORACLE_FILTER_H

#include <stdint.h>

#include "builder/traverse/ray.h"

enum { ORACLE_FILTER_BLOCK = 256 }; /* 8 KiB of spheres, which stay in the first-level cache for all rays */

struct oracle_filter_block {
    double centre[3][ORACLE_FILTER_BLOCK];
    double reach[ORACLE_FILTER_BLOCK]; /* the radius, plus what directions that turn by `wobble` add */
    double wobble; /* of oracle_filter_begin */
    uint32_t count;
};

/*
 * Coordinates across a ray's line: two unit vectors perpendicular to it and to each other, and the ray's origin along
 * each of them.
 */
struct oracle_filter_ray {
    double across[2][3];
    double offset[2];
    double slack; /* added to every reach: how much one-ulp moves of the ray can change `offset` */
};

/*
 * Prepares a ray, which must be ORACLE_RAY_GOOD. Returns the angle by which its direction may turn, rounding included.
 */
double oracle_filter_ray_init(struct oracle_filter_ray *ret_filter, const struct ray *ray);

/* Empties the block. `wobble` is the largest angle that oracle_filter_ray_init has returned for the rays to come. */
void oracle_filter_begin(struct oracle_filter_block *block, double wobble);
/* Adds a primitive, given by a sphere round it and its moves, to a block that is not full. */
void oracle_filter_add(struct oracle_filter_block *block, const double centre[3], double radius);

/*
 * Writes the indices of the primitives that the ray may meet to ret_near, ascending, and returns their number. The
 * result is the same on every instruction set.
 */
uint32_t oracle_filter_scan(const struct oracle_filter_block *block, const struct oracle_filter_ray *ray,
                            uint16_t ret_near[ORACLE_FILTER_BLOCK]);

#endif
