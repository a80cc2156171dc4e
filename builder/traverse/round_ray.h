/* SPDX-License-Identifier: Apache-2.0 */
/* round_ray.h - a ray in one object's space, as the tests of spheres and of linear swept spheres take it. */
#ifndef BVHD_ROUND_RAY_H
#define BVHD_ROUND_RAY_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

struct round_ray {
    double origin[3];
    double direction[3]; /* times `scale`, a power of two, so that the largest component is in [0.5, 1) */
    double scale; /* the distance t of the ray is that along `direction` times this */
    double tmin; /* where the ray begins, along `direction`; hits before that need not be reported */
};

/* The largest relative error of the distance at which a ray enters. The box tests allow for it (boxtest.h). */
static const double round_distance_error = 0x1p-43;

/* Returns a power of two by which a positive number is divided to be in [0.5, 1), or nearly so if it is extreme. */
static inline double round_ray_scale(double size)
{
    uint64_t bits;
    memcpy(&bits, &size, sizeof bits);
    bits = (bits + (UINT64_C(1) << 52)) & UINT64_C(0x7ff0000000000000);
    const uint64_t least = UINT64_C(8) << 52, most = UINT64_C(0x7f0) << 52; /* so that its inverse is a number, too */
    bits = bits < least ? least : bits > most ? most : bits;
    double scale;
    memcpy(&scale, &bits, sizeof scale);
    return scale;
}

/* Prepares a ray. The direction is finite and not zero. */
static inline void round_ray_init(const double origin[3], const double direction[3], double tmin,
                                  struct round_ray *ret_ray)
{
    const double x = fabs(direction[0]), y = fabs(direction[1]), z = fabs(direction[2]), xy = x > y ? x : y;
    const double size = round_ray_scale(xy > z ? xy : z), inverse = 1 / size;
    for (int k = 0; k < 3; k++) {
        ret_ray->origin[k] = origin[k];
        ret_ray->direction[k] = direction[k] * inverse;
    }
    ret_ray->scale = inverse;
    ret_ray->tmin = tmin * size;
}

#endif
