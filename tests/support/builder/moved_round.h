/* SPDX-License-Identifier: Apache-2.0 */
/*
 * moved_round.h - intersects a ray with a sphere or a linear swept sphere in extended precision, by the equations of
 * its parts: two spheres and the cone that touches them. For tests of the oracle, which searches instead.
 */
#ifndef BVHD_TEST_MOVED_ROUND_H
#define BVHD_TEST_MOVED_ROUND_H

#include "tests/support/builder/moved.h"

struct moved_round {
    long double centres[2][3], radii[2];
    bool caps[2];
    long double origin[3], direction[3]; /* in the same space */
};

/* A point of the ray, from the first centre. */
static inline void moved_round_point(const struct moved_round *m, long double t, long double ret[3])
{
    for (int axis = 0; axis < 3; axis++)
        ret[axis] = m->origin[axis] + t * m->direction[axis] - m->centres[0][axis];
}

/* Solves a t^2 + 2 b t + c = 0. Returns whether there are roots; *ret_first need not be the smaller one. */
static inline bool moved_round_roots(long double a, long double b, long double c, long double ret_roots[2])
{
    long double square = b * b - a * c;
    if (!(square >= 0))
        return false;
    long double q = -(b + copysignl(sqrtl(square), b));
    ret_roots[0] = q / a;
    ret_roots[1] = c / q;
    return true;
}

/* Computes where the ray enters the sphere at one end. */
static inline bool moved_round_sphere(const struct moved_round *m, int end, long double *ret_t)
{
    long double from[3], roots[2];
    for (int axis = 0; axis < 3; axis++)
        from[axis] = m->origin[axis] - m->centres[end][axis];
    if (!moved_round_roots(moved_dot(m->direction, m->direction), moved_dot(from, m->direction),
                           moved_dot(from, from) - m->radii[end] * m->radii[end], roots))
        return false;
    *ret_t = fminl(roots[0], roots[1]);
    return true;
}

/* Returns whether the ray enters the body through its surface at all, and where; t may be negative. */
static inline bool moved_round_meet(const struct moved_round *m, long double *ret_t)
{
    const long double *radii = m->radii;
    long double axis[3], from[3], point[3], taper = radii[0] - radii[1], t, least = INFINITY, roots[2];
    for (int k = 0; k < 3; k++) {
        axis[k] = m->centres[1][k] - m->centres[0][k];
        from[k] = m->origin[k] - m->centres[0][k];
    }
    long double square = moved_dot(axis, axis);
    if (square <= taper * taper) {
        int larger = radii[1] > radii[0];
        return m->caps[larger] && moved_round_sphere(m, larger, ret_t);
    }
    /* distances along the axis are multiplied by the length of the axis */
    const long double first = radii[0] * taper, second = square + radii[1] * taper;
    for (int end = 0; end < 2; end++) {
        if (!m->caps[end] || !moved_round_sphere(m, end, &t))
            continue;
        moved_round_point(m, t, point);
        long double along = moved_dot(point, axis);
        if (end ? along >= second : along <= first)
            least = fminl(least, t);
    }
    /* (D.D - k k)(X.X - r0 r0) = (X.D - k r0)^2 for a point X of the cone */
    long double scale = square - taper * taper, steep = moved_dot(m->direction, axis);
    long double start = moved_dot(from, axis) - first;
    if (moved_round_roots(scale * moved_dot(m->direction, m->direction) - steep * steep,
                          scale * moved_dot(from, m->direction) - start * steep,
                          scale * (moved_dot(from, from) - radii[0] * radii[0]) - start * start, roots))
        for (int i = 0; i < 2; i++) {
            moved_round_point(m, roots[i], point);
            long double along = moved_dot(point, axis), z = (along - first) / scale;
            long double slope = moved_dot(point, m->direction) - z * steep; /* outer normal times direction */
            if (along >= first && along <= second && slope <= 0)
                least = fminl(least, roots[i]);
        }
    *ret_t = least;
    return least < INFINITY;
}

#endif
