/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_triangle.h - tests one ray against one triangle, with bounds on every error: the exact second pass of the
 * oracle.
 *
 * It is a running error analysis in doubles. Each quantity has a centre and a radius, which enclose every value that it
 * can take while each input (vertex, matrix and ray component) moves by up to one float ulp, rounding included. The
 * geometry is that of Woop (2013): vertices are sheared onto the ray, along the axis in which its direction is largest,
 * so that the radii of the edge functions stay in proportion to the triangle and not to its distance. Floats, and
 * products of up to four of them, neither overflow nor underflow a double.
 */
#ifndef BVHD_ORACLE_TRIANGLE_H
#define BVHD_ORACLE_TRIANGLE_H

#include <float.h>
#include <stdbool.h>

#include "builder/traverse/ray.h"

/* The interval [centre - radius, centre + radius]. */
struct radial {
    double centre, radius;
};

/* Returns the interval of a float that may move by one ulp, the distance between floats at its magnitude. */
struct radial radial_input(float value);
struct radial radial_add(struct radial a, struct radial b);
struct radial radial_sub(struct radial a, struct radial b);
struct radial radial_mul(struct radial a, struct radial b);

/* A triangle in world space. */
struct oracle_triangle {
    struct radial corners[3][3];
    bool mirrored; /* the transform has reversed its winding; facing is that of object space and does not change */
};

/* A ray, prepared for tests against many triangles. */
struct oracle_ray {
    int x, y, z; /* axes: z is the one along which the direction is largest, x and y follow it cyclically */
    struct radial origin[3]; /* along x, y, z */
    struct radial shear[2]; /* direction x and y, divided by direction z */
    struct radial direction_z;
    float tmin, tmax;
    uint32_t flags;
};

enum oracle_ray_kind { ORACLE_RAY_GOOD, ORACLE_RAY_EMPTY, ORACLE_RAY_VAGUE };

/*
 * Prepares a ray. EMPTY: its direction is zero, or a component is not finite, and it hits nothing. VAGUE: an ulp of its
 * direction is as large as the direction, so that no hit is certain.
 */
enum oracle_ray_kind oracle_ray_init(struct oracle_ray *ret_prepared, const struct ray *ray);

enum oracle_presence { ORACLE_ABSENT, ORACLE_POSSIBLE, ORACLE_SURE };

struct oracle_crossing {
    double t;
    /*
     * the interval of t for comparisons with other triangles on the same ray. It leaves out the moves of inputs that
     * shift the t of all triangles alike, and is wide enough to meet that of every distance which counts as equal
     * (bvhd_cpu.h: to 32 significant bits)
     */
    double low, high;
    double shift; /* what those moves add: t itself is in [low - shift, high + shift] */
};

/* The triangle as it is seen along the ray, which is at 0. */
struct oracle_outline {
    double corners[3][2];
    bool sure[3]; /* [k]: the ray surely does not pass through edge k, which is opposite to corner k */
    bool positive; /* the sign of the area */
    bool open; /* only the edges leave it open whether it is hit: distance and facing are sure */
};

/*
 * Returns whether the ray meets the triangle between tmin and tmax. Of the ray's flags, those of culling by facing are
 * honoured and no others. *ret_crossing is filled in unless the result is ABSENT, *ret_outline if it is POSSIBLE.
 */
enum oracle_presence oracle_triangle_meet(const struct oracle_ray *ray, const struct oracle_triangle *triangle,
                                          struct oracle_crossing *ret_crossing, struct oracle_outline *ret_outline);

#endif
