/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_animation.h - an animation of a glTF file: which properties of nodes it sets, and their keys. */
#ifndef BVHCTL_GLTF_ANIMATION_H
#define BVHCTL_GLTF_ANIMATION_H

#include "client/bvhctl/scene/gltf_json.h"
#include "client/bvhctl/scene/gltf_sampler.h"

/* The property of a node that a channel sets. */
enum gltf_path { GLTF_TRANSLATION, GLTF_ROTATION, GLTF_SCALE, GLTF_WEIGHTS, GLTF_PATHS };

struct gltf_channel {
    uint32_t node;
    enum gltf_path path;
    struct gltf_sampler sampler; /* its arrays belong to the animation */
};

struct gltf_animation {
    struct gltf_channel *channels;
    uint32_t count;
    struct gltf_decoded *decoded; /* the arrays of the samplers */
};

/*
 * Reads animations[index], of which everything is checked: references, accessors, times, that each property has one
 * channel, and that each key is finite. Channels without a node or with an unknown path are counted. *ret_animation
 * ends with gltf_animation_finish, also after an error.
 */
enum bvhd_status gltf_animation_read(struct gltf_file *file, uint32_t index, struct gltf_animation *ret_animation);

/* Accepts a zeroed animation. */
void gltf_animation_finish(const struct gltf_file *file, struct gltf_animation *animation);

#endif
