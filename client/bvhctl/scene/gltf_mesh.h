/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_mesh.h - makes meshes of an import from the primitives of a glTF mesh. */
#ifndef BVHCTL_GLTF_MESH_H
#define BVHCTL_GLTF_MESH_H

#include "client/bvhctl/scene/gltf_json.h"
#include "client/bvhctl/scene/import.h"

/* Returns the number of primitives of meshes[index]. */
enum bvhd_status gltf_mesh_primitives(const struct gltf_file *file, uint32_t index, uint32_t *ret_count);

/*
 * Decodes all primitives of meshes[index] into as many import meshes, which are zeroed. Lists, strips and fans of
 * triangles become triangles. Points and lines become meshes of these if the wish has a radius for them; their own
 * radii are those of the attribute _RADIUS, or half of _WIDTH. Their vertices are in the order of the file: the caller
 * orders them (import_round.h). Primitives that the wish leaves out, or without positions, become meshes without a
 * triangle, and are counted. import_finish frees what was made, also after an error.
 */
enum bvhd_status gltf_mesh_read(struct gltf_file *file, uint32_t index, const struct import_wish *wish,
                                struct import_mesh *ret_meshes);

#endif
