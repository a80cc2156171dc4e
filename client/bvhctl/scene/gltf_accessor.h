/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf_accessor.h - decodes accessors of a glTF file: all component types, normalized integers, strides, and sparse
 * ones, also those without a buffer view.
 */
#ifndef BVHCTL_GLTF_ACCESSOR_H
#define BVHCTL_GLTF_ACCESSOR_H

#include "client/bvhctl/scene/gltf_json.h"

enum gltf_component {
    GLTF_INT8 = 5120,
    GLTF_UINT8 = 5121,
    GLTF_INT16 = 5122,
    GLTF_UINT16 = 5123,
    GLTF_UINT32 = 5125,
    GLTF_FLOAT = 5126
};

/* A row of elements in a buffer view. */
struct gltf_elements {
    const unsigned char *data; /* NULL: all are zero */
    uint32_t stride; /* in bytes */
    uint32_t count;
};

struct gltf_accessor {
    uint32_t index; /* in the list of accessors */
    enum gltf_component component;
    uint32_t components; /* in an element: 1 to 4; 16 in a matrix */
    bool is_normalized;
    struct gltf_elements elements;
    /* the elements that replace others; their count is 0 unless the accessor is sparse */
    struct gltf_elements sparse_indices, sparse_values;
    enum gltf_component sparse_component; /* of sparse_indices */
};

/*
 * Opens accessors[index]. All offsets, strides, alignments and counts are checked, and the bytes of all elements are
 * there.
 */
enum bvhd_status gltf_accessor_open(struct gltf_file *file, uint32_t index, struct gltf_accessor *ret_accessor);

/* Does the same for an accessor of matrices of four columns of four floats, which gltf_accessor_open refuses. */
enum bvhd_status gltf_accessor_open_matrices(struct gltf_file *file, uint32_t index,
                                             struct gltf_accessor *ret_accessor);

/* Decodes all elements to floats; there are elements.count times `components` of them. */
enum bvhd_status gltf_accessor_floats(const struct gltf_file *file, const struct gltf_accessor *accessor,
                                      float *ret_floats);

/* Decodes all elements of an accessor of unsigned scalars. */
enum bvhd_status gltf_accessor_indices(const struct gltf_file *file, const struct gltf_accessor *accessor,
                                       uint32_t *ret_indices);

/*
 * Compares "min" and "max" of an accessor of three components with its decoded elements. Returns false if they differ
 * by more than rounding explains. They are in units of the stored components, before normalization. An accessor without
 * them agrees.
 */
bool gltf_accessor_bounds_agree(const struct gltf_file *file, const struct gltf_accessor *accessor,
                                const float *positions);

#endif
