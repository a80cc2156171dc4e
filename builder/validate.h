/* SPDX-License-Identifier: Apache-2.0 */
/*
 * validate.h - Vulkan's valid-usage rules that can be decided from a request alone, each reported by its VUID and place.
 *
 * Three steps, in the order in which things become known: the batch as a whole, one entry's fields (before any of its memory is read),
 * and the contents of the private canonical copy. Places look like "infos[2].geometries[3].triangles.vertexStride",
 * "ranges[2][3].primitiveOffset", "infos[0].geometries[0].instances[17].flags". The first broken rule is reported. Pure functions.
 */
#ifndef BVHD_VALIDATE_H
#define BVHD_VALIDATE_H

#include "canonical.h"
#include "geometry.h"
#include "limits.h"
#include "memory.h"
#include "status.h"

/*
 * Rules between the entries of one call (row F17), for entry `index`: its destination is nobody else's (03698), its source nobody's
 * destination (03403), none of its references another entry's destination (03407). Handles 0 are ignored. An entry that breaks a rule
 * fails alone. Use validate_batch to check all entries in O(n log n).
 *
 * ret_errors[count]: BVHD_OK or the error of each entry. BVHD_NO_MEMORY when it could not check.
 */
enum bvhd_status validate_batch(const struct build_input *inputs, uint32_t count, struct memory *memory, struct bvhd_error *ret_errors);

/* Rules on the fields of one entry, `index` in its batch: types, flags, modes, formats, strides, alignments, counts, presence of memory. */
enum bvhd_status validate_input(const struct build_input *input, uint32_t index, const struct limits *limits, struct bvhd_error *error);

/* Rules on contents: AABB min <= max, invertible matrices, instance flags. Indices are checked while they are fetched (prepare.h). */
enum bvhd_status validate_canonical(const struct canonical *canonical, uint32_t index, struct bvhd_error *error);

/* 3x3 part of a row-major 3x4 matrix is invertible: its determinant, in double, is finite and not 0. */
bool validate_invertible(const float matrix[12]);

#endif
