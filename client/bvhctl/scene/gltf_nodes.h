/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_nodes.h - walks the nodes of the chosen scenes of a glTF file. */
#ifndef BVHCTL_GLTF_NODES_H
#define BVHCTL_GLTF_NODES_H

#include "client/bvhctl/scene/gltf_pose.h"

/*
 * A form in which nodes show a mesh. At rest each mesh has one. In a pose, each node with a skin, or with weights of
 * morph targets of its own, has a form of its own; all others share that of their mesh.
 */
struct gltf_form {
    uint32_t mesh;
    uint32_t first_node; /* the first node that shows it, in depth-first order */
    bool is_own; /* only that node shows it, with its skin and its weights */
    bool is_skinned; /* a node shows it that has a skin */
    uint32_t first_mesh, mesh_count; /* its import meshes, once they are numbered */
    uint32_t next; /* the next form of the same mesh + 1; 0: there is none */
};

struct gltf_forms {
    struct gltf_form *items; /* in the order in which nodes show them */
    uint32_t count;
    uint64_t capacity;
    struct gltf_form_list {
        uint32_t first, last; /* forms + 1, in their order; 0: no node shows the mesh */
        uint32_t common; /* the one that is no node's own + 1 */
    } * lists; /* one for each mesh of the file */
};

/* Where an instance is: at a node, or at a place that the node has for one of many (EXT_mesh_gpu_instancing). */
struct gltf_spot {
    uint32_t node;
    bool is_still; /* it is where the world is, wherever the node is */
    bool has_local;
    struct gltf_matrix local; /* from the instance to the node */
};

/*
 * Adds an instance to the import for each node that has a mesh, in depth-first order, or for each instance of
 * EXT_mesh_gpu_instancing at such a node. `bottom` of an instance is the number of its form, for now. In a pose, which
 * may be NULL, the nodes are placed, and an instance of a skinned mesh is where the world is, as its joints are. The
 * lists of ret_forms are there, zeroed; its items are the caller's to free, also after an error. So is *ret_spots,
 * which is NULL at first: one for each instance. ret_spots itself may be NULL, or else there is a pose.
 *
 * Nodes are trees: one that is reached twice is an error, which covers cycles. Without scenes the roots are all nodes
 * that are no children. `scene` is the scene to walk, or GLTF_ALL_SCENES. Nodes with a mesh that no scene reaches are
 * counted then.
 */
enum bvhd_status gltf_nodes_walk(struct gltf_file *file, uint32_t scene, struct gltf_pose *pose, struct import *import,
                                 struct gltf_forms *ret_forms, struct gltf_spot **ret_spots);

enum { GLTF_ALL_SCENES = -1 };

#endif
