/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf_pose.h - the nodes of a glTF file at a moment of one of its animations: what the animation says about them, and
 * where they are in the world. Skins and morph targets follow from it (gltf_deform.h).
 */
#ifndef BVHCTL_GLTF_POSE_H
#define BVHCTL_GLTF_POSE_H

#include "client/bvhctl/scene/gltf_animation.h"
#include "client/bvhctl/scene/gltf_transform.h"

struct gltf_skin;

struct gltf_posed_node {
    struct gltf_animated animated;
    double *weights; /* of morph targets, by the animation; NULL: it does not say */
    uint32_t weight_count;
    bool is_placed; /* a scene that is read has it: */
    bool moves; /* the animation sets its transform, or that of a node above it */
    uint32_t parent; /* GLTF_NO_NODE: none */
    struct gltf_local local; /* what the file says */
    struct gltf_matrix world; /* from its space to the world */
};

#define GLTF_NO_NODE UINT32_MAX

struct gltf_pose {
    struct gltf_posed_node *nodes; /* one for each node of the file */
    uint32_t *placed; /* the nodes that are placed, each after its parent */
    uint32_t placed_count;
    struct gltf_skin *skins; /* one for each skin of the file, which is read when it is first needed */
    bool has_animation; /* the file has one: */
    uint32_t index; /* its number */
    struct gltf_animation animation;
};

/*
 * Reads and evaluates the chosen animation, as gltf_animation_read does. *ret_pose ends with gltf_pose_finish, also
 * after an error; gltf_nodes_walk places the nodes.
 */
enum bvhd_status gltf_pose_read(struct gltf_file *file, const struct import_moment *moment, struct gltf_pose *ret_pose);

/*
 * Places a node for which nothing is placed yet, below its parent, which is placed or GLTF_NO_NODE. Returns where it
 * is.
 */
const struct gltf_matrix *gltf_pose_place(struct gltf_pose *pose, uint32_t node, uint32_t parent,
                                          const struct gltf_local *local);

/* Moves everything to another time, in seconds. Skins are read again then. */
void gltf_pose_move(const struct gltf_file *file, struct gltf_pose *pose, double time);

/* Accepts a zeroed pose. */
void gltf_pose_finish(const struct gltf_file *file, struct gltf_pose *pose);

#endif
