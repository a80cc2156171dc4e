/* SPDX-License-Identifier: Apache-2.0 */
/*
 * candidates.h - finds the boxes that a ray meets, in extended precision, for tests of AABB candidates. It shares no
 * code with the traversal.
 */
#ifndef BVHD_CANDIDATES_H
#define BVHD_CANDIDATES_H

#include <math.h>
#include <stdbool.h>

#include "builder/traverse/traverse.h"

struct long_ray {
    long double origin[3], direction[3], tmin, tmax;
};

static inline struct long_ray candidates_ray(const struct ray *ray)
{
    struct long_ray copy = {.tmin = ray->tmin, .tmax = ray->tmax};
    for (int axis = 0; axis < 3; axis++) {
        copy.origin[axis] = ray->origin[axis];
        copy.direction[axis] = ray->direction[axis];
    }
    return copy;
}

/* Inverts the first three columns of a row-major 3x4 matrix. */
static inline void candidates_invert(const float m[12], long double ret_inverse[3][3])
{
    long double det = 0;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++) {
            int a = (column + 1) % 3, b = (column + 2) % 3, c = (row + 1) % 3, d = (row + 2) % 3;
            ret_inverse[row][column] =
                (long double)m[4 * a + c] * m[4 * b + d] - (long double)m[4 * a + d] * m[4 * b + c];
        }
    for (int k = 0; k < 3; k++)
        det += m[k] * ret_inverse[k][0];
    for (int k = 0; k < 9; k++)
        ret_inverse[k / 3][k % 3] /= det;
}

/* Transforms the ray into an instance's own space, by the inverse of a row-major 3x4 matrix. */
static inline struct long_ray candidates_ray_into(const struct long_ray *ray, const float m[12])
{
    long double inverse[3][3];
    candidates_invert(m, inverse);
    struct long_ray local = {.tmin = ray->tmin, .tmax = ray->tmax};
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++) {
            local.origin[row] += inverse[row][column] * (ray->origin[column] - m[4 * column + 3]);
            local.direction[row] += inverse[row][column] * ray->direction[column];
        }
    return local;
}

/*
 * Computes the interval [*ret_near, *ret_far] of the ray in a box that is larger by `grow` on each side; returns
 * whether it is not empty. A box with a NaN is never met.
 */
static inline bool candidates_meet(const struct long_ray *ray, const float box[6], long double grow,
                                   long double *ret_near, long double *ret_far)
{
    long double near = ray->tmin, far = ray->tmax;
    for (int axis = 0; axis < 3; axis++) {
        long double low = box[axis] - grow, high = box[3 + axis] + grow, o = ray->origin[axis],
                    d = ray->direction[axis];
        if (isnan(low) || isnan(high))
            return false;
        if (d == 0) {
            if (o < low || o > high)
                return false;
            continue;
        }
        long double a = (low - o) / d, b = (high - o) / d;
        near = fmaxl(near, fminl(a, b));
        far = fminl(far, fmaxl(a, b));
    }
    *ret_near = near;
    *ret_far = far;
    return near <= far;
}

/*
 * Returns whether the box is certainly met, despite rounding in extended precision or a `slack` as a share of t. A ray
 * without a direction meets nothing (ray.h).
 */
static inline bool candidates_surely_meet(const struct long_ray *ray, const float box[6], long double slack)
{
    long double near, far;
    int moving = (ray->direction[0] != 0) + (ray->direction[1] != 0) + (ray->direction[2] != 0);
    if (moving == 0 || !candidates_meet(ray, box, 0, &near, &far))
        return false;
    return (moving == 1 && slack == 0) || near + (slack + 1e-16L) * (fabsl(near) + fabsl(far)) <= far;
}

#endif
