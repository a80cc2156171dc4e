/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_filter.h - which triangles of a block a ray's line may come near: the fast half of the oracle.
 *
 * A pair is dropped when the distance between the line and the centre of the triangle's bounding sphere exceeds the
 * sphere's radius and all that one-ulp moves of the inputs and rounding could add. It never drops a pair that
 * oracle_triangle.h would not call absent.
 */
#ifndef BVHD_ORACLE_FILTER_H
#define BVHD_ORACLE_FILTER_H

#include "client/bvhctl/oracle/oracle_triangle.h"

enum { ORACLE_FILTER_BLOCK = 256 }; /* 8 KiB of spheres: stays in the first-level cache while rays pass */

struct oracle_filter_block {
    double centre[3][ORACLE_FILTER_BLOCK];
    double reach[ORACLE_FILTER_BLOCK]; /* the radius, and what directions that turn by `wobble` add */
    double wobble;
    uint32_t count;
};

/*
 * Coordinates across the line: two unit vectors perpendicular to it and to each other, and where the origin lies along
 * them.
 */
struct oracle_filter_ray {
    double across[2][3];
    double offset[2];
    double slack;
};

/* Returns the angle by which the ray's direction may turn, with rounding. The ray is ORACLE_RAY_GOOD. */
double oracle_filter_ray_init(struct oracle_filter_ray *ret_filter, const struct ray *ray);

/* Empties the block; `wobble` is the largest of the rays that will be scanned. */
void oracle_filter_begin(struct oracle_filter_block *block, double wobble);
void oracle_filter_add(struct oracle_filter_block *block, struct radial corners[3][3]);

/*
 * The indices of the triangles that the ray may meet, ascending, to ret_near; returns how many. The same on every
 * instruction set.
 */
uint32_t oracle_filter_scan(const struct oracle_filter_block *block, const struct oracle_filter_ray *ray,
                            uint16_t ret_near[ORACLE_FILTER_BLOCK]);

#endif
