/* SPDX-License-Identifier: Apache-2.0 */
/*
 * moved.h - intersects a ray and a triangle whose inputs are moved by up to one float ulp, in extended precision. For
 * tests of the oracle.
 */
#ifndef BVHD_TEST_MOVED_H
#define BVHD_TEST_MOVED_H

#include <math.h>
#include <stdbool.h>

#include "client/bvhctl/oracle/rays.h"

struct moved {
    long double corners[3][3], origin[3], direction[3];
};

static inline long double moved_value(float value, uint64_t *state)
{
    float away = nextafterf(fabsf(value), INFINITY) - fabsf(value);
    return value + (long double)away * (2 * rays_uniform(state) - 1);
}

static inline void moved_cross(const long double a[3], const long double b[3], long double ret[3])
{
    for (int axis = 0; axis < 3; axis++)
        ret[axis] = a[(axis + 1) % 3] * b[(axis + 2) % 3] - a[(axis + 2) % 3] * b[(axis + 1) % 3];
}

static inline long double moved_dot(const long double a[3], const long double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The intersection of Moeller and Trumbore. */
static inline bool moved_meet(const struct moved *m, long double *ret_t)
{
    long double ab[3], ac[3], from_a[3], p[3], q[3];
    for (int axis = 0; axis < 3; axis++) {
        ab[axis] = m->corners[1][axis] - m->corners[0][axis];
        ac[axis] = m->corners[2][axis] - m->corners[0][axis];
        from_a[axis] = m->origin[axis] - m->corners[0][axis];
    }
    moved_cross(m->direction, ac, p);
    moved_cross(from_a, ab, q);
    long double det = moved_dot(ab, p), u = moved_dot(from_a, p), v = moved_dot(m->direction, q);
    if (det == 0)
        return false;
    *ret_t = moved_dot(ac, q) / det;
    u /= det;
    v /= det;
    return u >= 0 && v >= 0 && u + v <= 1;
}

#endif
