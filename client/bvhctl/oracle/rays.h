/* SPDX-License-Identifier: Apache-2.0 */
/* rays.h - the rays that `bvhctl check` and tests send: reproducible from a seed, on every machine. */
#ifndef BVHD_RAYS_H
#define BVHD_RAYS_H

#include "client/bvhctl/oracle/oracle.h"

/*
 * Fills ret_rays[count]. Even ones start outside the scene's box and aim at points inside random triangles (active
 * ones, thicker than a few ulps where there are such, each instance's as likely as it has triangles); where an ulp of
 * the direction would miss from out there, they start nearer. Odd ones start at random points in the box, grown a
 * little, in random directions. Unit directions, tmin 0, tmax FLT_MAX, mask 0xff, flags 0. Works at any magnitude that
 * floats have, and for scenes without any usable triangle.
 */
void rays_make(const struct oracle_mesh *meshes, uint32_t mesh_count, uint64_t seed, uint32_t count,
               struct ray *ret_rays);

/* splitmix64: the next value of *state. */
uint64_t rays_random(uint64_t *state);
/* Uniform in [0, 1). */
double rays_uniform(uint64_t *state);

#endif
