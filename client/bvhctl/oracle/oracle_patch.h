/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_patch.h - triangles that a ray may or may not hit one by one, but surely hits together.
 *
 * Seen along the ray, the boundary of a patch of triangles is a set of closed polygons, in which edges of neighbours
 * cancel out. Where moves of an ulp bring no boundary edge onto the ray, the winding number of the boundary round the
 * ray stays what it is; it is also the sum of the triangles' winding numbers, so while it is not 0 some triangle is
 * hit. A ray at an inner edge or corner of a mesh is certain that way, and so is one at a sliver thinner than an ulp:
 * exactly the rays that show leaks.
 */
#ifndef BVHD_ORACLE_PATCH_H
#define BVHD_ORACLE_PATCH_H

#include "client/bvhctl/oracle/oracle_triangle.h"

enum { ORACLE_PATCH_MAX = 64 };

/* A triangle that is open (oracle_triangle.h). */
struct oracle_patch_triangle {
    double corners[3][3]; /* in the world: equal ones are the same corner */
    uint32_t instance; /* only within one instance: there, equal corners are rounded alike */
    struct oracle_outline outline;
};

/*
 * Cuts triangles[count <= ORACLE_PATCH_MAX] into patches that hang together by edges: ret_patch[i] is the lowest
 * triangle of i's patch.
 */
void oracle_patch_find(const struct oracle_patch_triangle *triangles, uint32_t count,
                       uint32_t ret_patch[ORACLE_PATCH_MAX]);

/* True when the ray surely hits one of the triangles i with patch[i] == which. */
bool oracle_patch_covers(const struct oracle_patch_triangle *triangles, uint32_t count, const uint32_t *patch,
                         uint32_t which);

#endif
