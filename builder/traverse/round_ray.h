/* SPDX-License-Identifier: Apache-2.0 */
/* round_ray.h - a ray in one object's space, as the tests of spheres and of linear swept spheres take it. */
#ifndef BVHD_ROUND_RAY_H
#define BVHD_ROUND_RAY_H

#include <math.h>
#include <stdbool.h>

struct round_ray {
    double origin[3];
    double direction[3]; /* times 1 / scale, a power of two: the largest component is in [0.5, 1) */
    double scale; /* the distance t of the ray is its distance along `direction` times this */
    double tmin; /* where the ray begins, along `direction`; hits before that need not be reported */
};

/* The largest relative error of the distance at which a ray enters. */
static const double round_distance_error = 0x1p-41;

/* Prepares a ray. The direction is finite and not zero. */
static inline void round_ray_init(const double origin[3], const double direction[3], double tmin,
                                  struct round_ray *ret_ray)
{
    int exponent;
    frexp(fmax(fmax(fabs(direction[0]), fabs(direction[1])), fabs(direction[2])), &exponent);
    for (int k = 0; k < 3; k++) {
        ret_ray->origin[k] = origin[k];
        ret_ray->direction[k] = ldexp(direction[k], -exponent);
    }
    ret_ray->scale = ldexp(1, -exponent);
    ret_ray->tmin = tmin / ret_ray->scale;
}

#endif
