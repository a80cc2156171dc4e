/* SPDX-License-Identifier: Apache-2.0 */
/*
 * swept_sphere.h - a ray against a linear swept sphere.
 *
 * Its ends are spheres with centres P0 and P1 and radii r0 and r1, D = P1 - P0, L = |D|, q = r0 - r1. If L <= |q|, one
 * end swallows the other: the shape is the sphere of the larger end, the first one if both are equal, if that end has a
 * cap, and nothing otherwise. Else the shape is the part of the cone around both spheres between the circles where it
 * touches them, and the part of each end's sphere beyond its circle, its cap, if the end has one. A ray hits where it
 * enters the shape from outside; where it meets the inner face, as through the opening of a missing cap, it hits
 * nothing.
 *
 * Seen along the ray o + t d, the sphere at share z of the way from P0 to P1 is a circle. With f = P0 - o, x = f
 * cross d and v = D cross d it has the centre x + z v and the radius |d| (r0 - z q), if lengths across the ray count
 * |d| times. The ray meets that sphere if
 *
 *   k z^2 - 2 g z + c <= 0,   k = v.v - q^2 d.d,   g = -(x.v + r0 q d.d),   c = x.x - r0^2 d.d,
 *
 * and meets the infinite cone if the discriminant h = g^2 - k c is not negative. With e = d.d (L^2 - q^2), which is
 * k + (D.d)^2, it enters the cone at t = f.d / d.d + w, where
 *
 *   w = (D.d g - sqrt(e h)) / (k d.d) = (e c - g^2) / (d.d (D.d g + sqrt(e h))),
 *
 * of which one form or the other has no cancellation between g and the root,
 * and there touches the sphere at z = y / (L^2 - q^2), y = g / d.d + w D.d. The cone is convex, and so is
 * the shape with both caps. So a ray that enters the cone at 0 <= z <= 1 enters the side there. If z < 0 it can enter
 * only the first cap, and does if it meets that end's sphere; if z > 1 the same holds for the second. A ray with k < 0
 * meets both halves of the double cone. If it enters the other half, which is when D.d q > 0, it comes out of the
 * opening of this one, and can enter only the cap of the larger end. So caps need no test of the circle that bounds
 * them, and there is no gap between a cap and the side.
 *
 * Signs are decided in double, and in twofold precision where the bounds of errors leave them open (twofold.h). What
 * that leaves open, some 2^-98 of the numbers that are compared, counts as follows: L = |q|, so that one end swallows
 * the other; h = 0, so that the ray is tangent and hits; 0 <= z <= 1, so that it hits the side; k = 0, so that it is
 * parallel to the cone. A ray that is parallel to the cone and does not enter the side meets the cap of the end from
 * which it comes, if there is one. A ray that runs within the side touches only the caps.
 */
#ifndef BVHD_SWEPT_SPHERE_H
#define BVHD_SWEPT_SPHERE_H

#include "builder/traverse/round_ray.h"

/* Where a ray's line enters a linear swept sphere. */
struct swept_sphere_hit {
    double t;
    double u; /* the share of the way to the second end at which the sphere is that the cone touches there; in [0, 1] */
};

/*
 * Returns whether the ray's line enters a linear swept sphere: at any t, but not at each t before ray->tmin. An end
 * is a centre and a radius; bit k of `caps`: end k has a cap. The error of t is that of sphere_intersect(). Shapes of
 * which both radii are 0, or that are not finite, are never met.
 */
bool swept_sphere_intersect(const struct round_ray *ray, const float first[4], const float second[4], unsigned caps,
                            struct swept_sphere_hit *ret_hit);

#endif
