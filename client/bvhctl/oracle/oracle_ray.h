/* SPDX-License-Identifier: Apache-2.0 */
/* oracle_ray.h - a ray as the oracle tests it against primitives, with a bound on each of its numbers. */
#ifndef BVHD_ORACLE_RAY_H
#define BVHD_ORACLE_RAY_H

#include "builder/traverse/ray.h"
#include "client/bvhctl/oracle/oracle_radial.h"

/* A ray, prepared for tests against many primitives. */
struct oracle_ray {
    int x, y, z; /* axes: z is the one along which the direction is largest, x and y follow it cyclically */
    struct radial origin[3]; /* along x, y, z */
    struct radial shear[2]; /* direction x and y, divided by direction z */
    struct radial direction_z;
    struct radial from[3], along[3]; /* origin and direction in the order of the world's axes */
    float tmin, tmax;
    uint32_t flags;
};

enum oracle_ray_kind { ORACLE_RAY_GOOD, ORACLE_RAY_EMPTY, ORACLE_RAY_VAGUE };

/*
 * Prepares a ray. EMPTY: its direction is zero, or a component is not finite, and it hits nothing. VAGUE: an ulp of its
 * direction is as large as the direction, so that no hit is certain.
 */
enum oracle_ray_kind oracle_ray_init(struct oracle_ray *ret_prepared, const struct ray *ray);

#endif
