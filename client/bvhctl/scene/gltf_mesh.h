/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_mesh.h - makes meshes of an import from the primitives of a glTF mesh. */
#ifndef BVHCTL_GLTF_MESH_H
#define BVHCTL_GLTF_MESH_H

#include "client/bvhctl/scene/gltf_json.h"

/* Returns the number of primitives of meshes[index]. */
enum bvhd_status gltf_mesh_primitives(const struct gltf_file *file, uint32_t index, uint32_t *ret_count);

/*
 * Decodes all primitives of meshes[index] into as many import meshes, which are zeroed. Lists, strips and fans of
 * triangles become triangles. Primitives of other kinds, or without positions, become meshes without a triangle, so
 * that the number of a geometry is the number of its primitive; they are counted. import_finish frees what was made,
 * also after an error.
 */
enum bvhd_status gltf_mesh_read(struct gltf_file *file, uint32_t index, struct import_mesh *ret_meshes);

#endif
