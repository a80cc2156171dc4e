/* SPDX-License-Identifier: Apache-2.0 */
/* rays.h - the rays that `bvhctl check` and tests trace. One seed gives the same rays on every machine. */
#ifndef BVHD_RAYS_H
#define BVHD_RAYS_H

#include "client/bvhctl/oracle/oracle.h"

/*
 * Fills ret_rays[count]. Rays with even numbers start outside the scene's bounding box and aim at points inside random
 * triangles, which for round primitives lie inside these. These triangles are active and, if there are such, thicker
 * than a few ulps; an instance is chosen with a probability in proportion to its number of primitives. A ray starts
 * nearer to its triangle if an ulp of the direction would make it miss from outside. Rays with odd numbers start at
 * random points of the box, slightly enlarged, in random directions. All directions are unit vectors, tmin is 0, tmax
 * is FLT_MAX, the mask is 0xff, and the flags are 0. The function works at any magnitude that floats have, and for
 * scenes without any usable triangle.
 *
 * Where something moves, rays come in eight stretches of one time each: 0, 1, 1/2 and five others. Points and boxes are
 * those of the ray's time. Elsewhere the time is 0.
 */
void rays_make(const struct oracle_mesh *meshes, uint32_t mesh_count, uint64_t seed, uint32_t count,
               struct ray *ret_rays);

/* Returns the next value of the generator splitmix64. */
uint64_t rays_random(uint64_t *state);
/* Returns the next value, uniform in [0, 1). */
double rays_uniform(uint64_t *state);

#endif
