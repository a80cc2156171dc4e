/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_triangle.h - a triangle as the oracle tests it against rays.
 *
 * The geometry of the test is that of Woop (2013): vertices are sheared onto the ray, along the axis in which its
 * direction is largest, so that the radii of the edge functions stay in proportion to the triangle and not to its
 * distance.
 */
#ifndef BVHD_ORACLE_TRIANGLE_H
#define BVHD_ORACLE_TRIANGLE_H

#include "client/bvhctl/oracle/oracle_radial.h"

/* A triangle in world space. */
struct oracle_triangle {
    struct radial corners[3][3];
    bool vague; /* the transform moves, and may be singular: nothing is certain */
    bool mirrored; /* the transform has reversed its winding; facing is that of object space and does not change */
};

#endif
