/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_transform.h - the matrices of glTF nodes, in double precision. They are rounded to float once, at the end. */
#ifndef BVHCTL_GLTF_TRANSFORM_H
#define BVHCTL_GLTF_TRANSFORM_H

#include "client/bvhctl/scene/gltf_json.h"

/* A row-major 3x4 matrix. */
struct gltf_matrix {
    double at[12];
};

struct gltf_trs {
    double translation[3], rotation[4], scale[3]; /* the rotation is a quaternion: x, y, z, w */
};

/* What a file says about the transform of a node. */
struct gltf_local {
    bool is_matrix; /* it is a matrix, or else a translation, a rotation and a scale: */
    struct gltf_matrix matrix;
    struct gltf_trs trs;
};

/* What an animation says about the transform of a node; the file says the rest. */
struct gltf_animated {
    bool has_translation, has_rotation, has_scale;
    struct gltf_trs trs;
};

extern const struct gltf_matrix gltf_matrix_identity;
extern const struct gltf_trs gltf_trs_identity;

/* Returns the matrix that scales, then rotates, then moves. */
struct gltf_matrix gltf_trs_matrix(const struct gltf_trs *trs);

/* Makes the rotation a unit quaternion. A zero quaternion stays. */
void gltf_trs_normalize(struct gltf_trs *trs);

/* Returns the matrix that applies `b`, then `a`. */
struct gltf_matrix gltf_matrix_product(const struct gltf_matrix *a, const struct gltf_matrix *b);

/* Rounds to floats. Returns whether the result is finite and has an inverse. */
bool gltf_matrix_round(const struct gltf_matrix *matrix, float ret_rounded[12]);

/* Takes a matrix of four columns of four. Returns false if it is not finite, or its last row is not 0, 0, 0, 1. */
bool gltf_matrix_from_columns(const double columns[16], struct gltf_matrix *ret_matrix);

/* Reads "matrix" of a node, or else "translation", "rotation" and "scale". */
enum bvhd_status gltf_transform_read(const struct gltf_file *file, const struct gltf_value *node,
                                     struct gltf_local *ret_local);

/* Returns the matrix of a node. `animated`, which may be NULL, replaces what it has of what is no matrix. */
struct gltf_matrix gltf_transform_matrix(const struct gltf_local *local, const struct gltf_animated *animated);

#endif
