/* SPDX-License-Identifier: Apache-2.0 */
/* round_surface.h - the surfaces of spheres and linear swept spheres, for pictures. */
#ifndef BVHCTL_ROUND_SURFACE_H
#define BVHCTL_ROUND_SURFACE_H

#include "client/bvhctl/picture/vector.h"
#include "client/bvhctl/scene/structure.h"

/*
 * Returns the outward unit normal in world space where a ray hit at `position`, also in world space. `u` is that of the
 * hit: it says which of the spheres that were swept touches the surface there. `object_to_world` may be NULL.
 */
struct vector round_surface_normal(const struct structure_round *round, const float *object_to_world,
                                   struct vector position, double u);

/*
 * Gives the corners of a triangle, in object space, that is as large as the round primitive seems from a side and about
 * where it is, for estimates that are made of triangles.
 */
void round_surface_stand_in(const struct structure_round *round, struct vector ret_corners[3]);

#endif
