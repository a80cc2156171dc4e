/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sphere.h - a ray against a sphere.
 *
 * A ray o + t d meets the sphere with centre c and radius r where |o + t d - c|^2 = r^2, and enters it at the smaller
 * root t. With f = c - o and x = f cross d, half the root's discriminant is r^2 d.d - x.x, the root
 *
 *   (f.d - sqrt(r^2 d.d - x.x)) / d.d = (f.f - r^2) / (f.d + sqrt(r^2 d.d - x.x)),
 *
 * of which one form or the other has no cancellation but in f.f - r^2. The sign of the discriminant decides between hit
 * and miss; 0, where the ray is tangent, is a hit. It is computed in double, with a bound for its error, and where the
 * bound leaves the sign open in twofold precision (twofold.h). Then the sign is exact if the products have no more bits
 * than that, as those of small integers do; else a discriminant counts as 0 if it is below some 2^-99 of what it is the
 * difference of. So a ray that is called a hit passes the sphere at a distance of at most 2^-99 of its way. For rays
 * that begin near the surface, f.f - r^2 is computed in the same precision, so that rays that begin inside have a
 * negative root, also if they begin only just inside, and those that begin on it 0.
 */
#ifndef BVHD_SPHERE_H
#define BVHD_SPHERE_H

#include "builder/traverse/round_ray.h"

/*
 * Returns whether the ray's line meets a sphere, of which the radius follows the centre, and where it enters: at any t,
 * but not at each t before ray->tmin. The relative error of t is at most round_distance_error, except within 2^-48 of
 * the way to the centre where a ray that begins there is tangent, too. Spheres without a positive radius, or which are
 * not finite, are never met.
 */
bool sphere_intersect(const struct round_ray *ray, const float sphere[4], double *ret_t);

#endif
