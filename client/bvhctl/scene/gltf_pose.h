/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf_pose.h - the nodes of a glTF file at a moment of one of its animations: what the animation says about them, and
 * where they are in the world. Skins and morph targets follow from it (gltf_deform.h).
 */
#ifndef BVHCTL_GLTF_POSE_H
#define BVHCTL_GLTF_POSE_H

#include "client/bvhctl/scene/gltf_transform.h"

struct gltf_skin;

struct gltf_posed_node {
    struct gltf_animated animated;
    double *weights; /* of morph targets, by the animation; NULL: it does not say */
    uint32_t weight_count;
    bool is_placed; /* a scene that is read has it: */
    struct gltf_matrix world; /* from its space to the world */
};

struct gltf_pose {
    struct gltf_posed_node *nodes; /* one for each node of the file */
    struct gltf_skin *skins; /* one for each skin of the file, which is read when it is first needed */
    bool has_animation; /* the file has one: */
    uint32_t animation; /* its number */
};

/*
 * Evaluates the chosen animation, of which everything is checked: references, accessors, times, that each property has
 * one channel, and that each key is finite. Channels without a node or with an unknown path are counted. *ret_pose ends
 * with gltf_pose_finish, also after an error; gltf_nodes_walk places the nodes.
 */
enum bvhd_status gltf_pose_read(struct gltf_file *file, const struct import_moment *moment, struct gltf_pose *ret_pose);

/* Accepts a zeroed pose. */
void gltf_pose_finish(const struct gltf_file *file, struct gltf_pose *pose);

#endif
