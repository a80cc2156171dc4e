/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_deform.h - moves the vertices of a glTF mesh by its morph targets, and then by a skin, in a pose. */
#ifndef BVHCTL_GLTF_DEFORM_H
#define BVHCTL_GLTF_DEFORM_H

#include "client/bvhctl/scene/gltf_nodes.h"

/* Returns how many morph targets the mesh of a node has, which its first primitive says; 0 without a mesh. */
enum bvhd_status gltf_deform_targets(const struct gltf_file *file, const struct gltf_value *node, uint32_t *ret_count);

/*
 * Moves the vertices of the import meshes that were read for a form of a mesh: sums of positions and weighted
 * displacements in double precision, then of what the joints make of them, rounded to float once. A NaN stays one.
 * Normals of meshes that moved are dropped, because they are not those of the new surface.
 */
enum bvhd_status gltf_deform(struct gltf_file *file, const struct gltf_pose *pose, const struct gltf_form *form,
                             struct import_mesh *meshes);

#endif
