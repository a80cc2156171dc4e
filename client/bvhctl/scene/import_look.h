/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_look.h - what meshes look like: smooth normals, base colour textures, vertex colours. Only pictures need it,
 * so it is read on demand (import_scene_with_looks).
 */
#ifndef BVHCTL_IMPORT_LOOK_H
#define BVHCTL_IMPORT_LOOK_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

/* How a texture continues outside of its image. The values are those of glTF. */
enum import_wrap { IMPORT_CLAMP = 33071, IMPORT_MIRROR = 33648, IMPORT_REPEAT = 10497 };

/* An image, in the curve of sRGB. It may be smaller than in its file. */
struct import_image {
    uint32_t width, height;
    unsigned char *rgba; /* rows from the top; alpha is not premultiplied. NULL: the image could not be read */
};

/* The arrays have an element for each vertex; each may be NULL. */
struct import_look {
    bool is_coloured; /* the file says which colour the mesh has */
    bool has_image;
    uint32_t image; /* of the import */
    enum import_wrap wrap[2]; /* along u and v */
    bool is_pixelated; /* neighbouring texels are not mixed */
    float factor[4]; /* the colour by which the texture is multiplied, linear, with alpha */
    float cutoff; /* where alpha is less than this, there is no surface; 0: everywhere is one */
    float *normals; /* xyz, unit */
    float *texcoords; /* uv */
    float *colours; /* rgba, linear */
};

void import_look_finish(struct import_look *look, struct memory *memory);

#endif
