/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_nodes.h - walks the nodes of the chosen scenes of a glTF file. */
#ifndef BVHCTL_GLTF_NODES_H
#define BVHCTL_GLTF_NODES_H

#include "client/bvhctl/scene/gltf_json.h"

/* How the nodes use a mesh. */
struct gltf_use {
    bool is_used, is_skinned;
    uint32_t first_node; /* the first node that has it, in depth-first order */
};

/*
 * Adds an instance to the import for each node that has a mesh, in depth-first order, or for each instance of
 * EXT_mesh_gpu_instancing at such a node. `bottom` of an instance is the number of its mesh in the file, for now.
 * ret_uses, zeroed, has an entry for each mesh of the file.
 *
 * Nodes are trees: one that is reached twice is an error, which covers cycles. Without scenes the roots are all nodes
 * that are no children. `scene` is the scene to walk, or GLTF_ALL_SCENES. Nodes with a mesh that no scene reaches are
 * counted then.
 */
enum bvhd_status gltf_nodes_walk(struct gltf_file *file, uint32_t scene, struct import *import,
                                 struct gltf_use *ret_uses);

enum { GLTF_ALL_SCENES = -1 };

#endif
