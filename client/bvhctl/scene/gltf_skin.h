/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_skin.h - the joints of a glTF skin in a pose, and how they move vertices. Internal to gltf_deform.h. */
#ifndef BVHCTL_GLTF_SKIN_H
#define BVHCTL_GLTF_SKIN_H

#include "client/bvhctl/scene/gltf_pose.h"

struct gltf_skin {
    uint32_t index; /* in the list of skins */
    struct gltf_matrix *matrices; /* one for each joint, from the space of the mesh to the world */
    uint32_t count;
};

/*
 * Returns skins[index], which is read once and belongs to the pose. Each joint has to be a node of a scene that is
 * read.
 */
enum bvhd_status gltf_skin_get(struct gltf_file *file, const struct gltf_pose *pose, uint32_t index,
                               const struct gltf_skin **ret_skin);

/* Accepts a zeroed skin. */
void gltf_skin_finish(const struct gltf_file *file, struct gltf_skin *skin);

/*
 * Moves the vertices of a primitive, xyz each, by all its sets of JOINTS_n and WEIGHTS_n. The weights of a vertex are
 * divided by their sum, which has to be positive.
 */
enum bvhd_status gltf_skin_apply(struct gltf_file *file, const struct gltf_skin *skin,
                                 const struct gltf_value *primitive, uint32_t vertex_count, double *positions);

#endif
