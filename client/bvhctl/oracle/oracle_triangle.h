/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_triangle.h - one ray against one triangle, with bounds on everything: the careful half of the oracle.
 *
 * Running error analysis in doubles: a quantity is a centre and a radius that holds every value it can take while each
 * input (vertex, matrix and ray component) moves by up to one float ulp, rounding included. The geometry is Woop's
 * (2013): along the axis in which the direction is largest, vertices are sheared onto the ray, where the radii of the
 * edge functions stay in proportion to the triangle instead of to its distance. Magnitudes: floats and products of up
 * to four of them neither overflow nor underflow a double.
 */
#ifndef BVHD_ORACLE_TRIANGLE_H
#define BVHD_ORACLE_TRIANGLE_H

#include <float.h>
#include <stdbool.h>

#include "builder/traverse/traverse.h"

/* Every value in [centre - radius, centre + radius]. */
struct radial {
    double centre, radius;
};

/* A float that may move by one ulp: the distance between floats at its magnitude. */
struct radial radial_input(float value);
struct radial radial_add(struct radial a, struct radial b);
struct radial radial_sub(struct radial a, struct radial b);
struct radial radial_mul(struct radial a, struct radial b);

/* A triangle in world space. */
struct oracle_triangle {
    struct radial corners[3][3];
    bool mirrored; /* the transform turned its winding round, which its facing must not see */
};

/* What does not depend on the triangle. */
struct oracle_ray {
    int x, y, z; /* axes; z the one along which the direction is largest, x and y follow it cyclically */
    struct radial origin[3]; /* by those axes */
    struct radial shear[2]; /* direction x and y over z */
    struct radial direction_z;
    float tmin, tmax;
    uint32_t flags;
};

enum oracle_ray_kind { ORACLE_RAY_GOOD, ORACLE_RAY_EMPTY, ORACLE_RAY_VAGUE };

/*
 * EMPTY: zero or not finite, it hits nothing. VAGUE: an ulp of its direction is as large as the direction, so nothing
 * is certain.
 */
enum oracle_ray_kind oracle_ray_init(struct oracle_ray *ret_prepared, const struct ray *ray);

enum oracle_presence { ORACLE_ABSENT, ORACLE_POSSIBLE, ORACLE_SURE };

struct oracle_crossing {
    double t;
    /* Where t lies beside the t of other triangles on the same ray. Moves that shift all of them alike are left out. */
    double low, high;
    double shift; /* those moves: t as such lies in [low - shift, high + shift] */
};

/* The triangle seen along the ray, which passes at 0. */
struct oracle_outline {
    double corners[3][2];
    bool sure[3]; /* the ray surely does not pass through edge k, opposite to corner k */
    bool positive; /* the sign of the area */
    bool open; /* whether it is hit depends on its edges alone: distance and facing are sure */
};

/*
 * Does the ray meet the triangle between tmin and tmax? Facing is honoured, no other flag. Fills *ret_crossing unless
 * ABSENT, *ret_outline when POSSIBLE.
 */
enum oracle_presence oracle_triangle_meet(const struct oracle_ray *ray, const struct oracle_triangle *triangle,
                                          struct oracle_crossing *ret_crossing, struct oracle_outline *ret_outline);

#endif
