/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf_look.h - reads what the meshes of a glTF file look like: normals, texture coordinates and colours of vertices,
 * base colour textures with KHR_texture_transform, and the alpha below which there is no surface.
 *
 * A mistake in it does not keep a scene from being drawn: what cannot be read is counted, and left out.
 */
#ifndef BVHCTL_GLTF_LOOK_H
#define BVHCTL_GLTF_LOOK_H

#include "client/bvhctl/scene/gltf_json.h"

struct gltf_looks {
    struct gltf_file file; /* that of the caller, with an error of its own */
    struct bvhd_error error;
    struct import *import; /* its images, and what was left out, are set */
    struct gltf_value textures, images, samplers; /* lists */
    bool *tried; /* of each image: it was decoded, or refused */
};

/* Prepares the reading. `file` stays open until it ends. BVHD_NO_MEMORY. End with gltf_looks_finish. */
enum bvhd_status gltf_looks_init(struct gltf_looks *looks, const struct gltf_file *file, struct import *import);
void gltf_looks_finish(struct gltf_looks *looks);

/* Sets the look of the mesh that was read from a primitive. */
void gltf_look_read(struct gltf_looks *looks, const struct gltf_value *primitive, struct import_mesh *mesh);

#endif
