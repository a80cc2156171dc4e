/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_round.h - points and lines of scene files as meshes of spheres and of linear swept spheres, and what differs
 * by the shape of a mesh.
 */
#ifndef BVHCTL_IMPORT_ROUND_H
#define BVHCTL_IMPORT_ROUND_H

#include "client/bvhctl/scene/import.h"

struct import_shape_kind {
    uint32_t corners; /* of a primitive, in the indices of its mesh */
    enum oracle_shape oracle;
    const char *one, *many; /* what primitives are called in messages */
    const char *name; /* in manifests */
    const char *ending; /* of the names of bottom levels whose meshes are part of one in the file */
};

/* By enum import_shape. */
extern const struct import_shape_kind import_shape_kinds[IMPORT_SHAPES];

/* Returns the number of indices of a mesh. */
static inline uint64_t import_corner_count(const struct import_mesh *mesh)
{
    return (uint64_t)mesh->primitive_count * import_shape_kinds[mesh->shape].corners;
}

/* Returns the radius that the wish has for points or lines; 0: they are left out. */
float import_round_radius(const struct import_wish *wish, enum import_shape shape);

/*
 * Finds the first radius that is not finite or is negative: no sphere can have it. Returns false if there is none.
 */
bool import_round_find_wrong(const float *radii, uint32_t count, uint32_t *ret_vertex);

/*
 * Orders the vertices of a mesh of points or lines by their use: point i becomes vertex i, and each line goes from a
 * vertex to the next one, which is also the first end of the next line if both have the same vertex there. So strips
 * become chains, whatever their indices were. Vertices that are not used are dropped, and those that several points or
 * chains use are repeated. Radii and vertex colours move along; normals and texture coordinates are dropped. The caps
 * of lines are found: those of a chain. Does nothing to meshes of triangles. Returns false when there is no memory, or
 * for more than 2^32 - 1 vertices.
 */
bool import_round_order(struct import_mesh *mesh, struct memory *memory);

/* Adds up the primitives of the meshes, by shape. */
void import_round_count(struct import *import);

/* Returns whether the import has any triangle, point or line. */
bool import_round_any(const struct import *import);

/* Returns what to add to a message about points and lines that were left out: the options that read them, or "". */
const char *import_round_hint(const struct import_counts *counts);

#endif
