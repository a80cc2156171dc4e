/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_patch.h - decides about groups of neighbouring triangles that a ray surely hits as a whole, although each of
 * them is only possibly hit.
 *
 * Seen along the ray, the boundary of a patch of triangles is a set of closed polygons, because the edges that two
 * triangles share cancel out. While moves of an ulp bring no boundary edge onto the ray, the winding number of the
 * boundary round the ray does not change. It is also the sum of the winding numbers of the triangles, so that some
 * triangle is hit if it is not 0. That makes rays certain that pass an inner edge or corner of a mesh, or a sliver
 * thinner than an ulp: exactly the rays that find leaks.
 */
#ifndef BVHD_ORACLE_PATCH_H
#define BVHD_ORACLE_PATCH_H

#include "client/bvhctl/oracle/oracle_kind.h"

enum { ORACLE_PATCH_MAX = 64 };

/* A triangle whose outline is `open` (oracle_kind.h). */
struct oracle_patch_triangle {
    /* Patches do not reach beyond one instance, because only within it equal corners are rounded alike. */
    uint32_t instance;
    struct oracle_outline outline;
};

/*
 * Divides triangles[count <= ORACLE_PATCH_MAX] into patches that are connected by edges: ret_patch[i] is the lowest
 * index of a triangle in the patch of triangle i.
 */
void oracle_patch_find(const struct oracle_patch_triangle *triangles, uint32_t count,
                       uint32_t ret_patch[ORACLE_PATCH_MAX]);

/* Returns whether the ray surely hits one of the triangles i with patch[i] == which. */
bool oracle_patch_covers(const struct oracle_patch_triangle *triangles, uint32_t count, const uint32_t *patch,
                         uint32_t which);

#endif
