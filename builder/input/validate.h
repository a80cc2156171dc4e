/* SPDX-License-Identifier: Apache-2.0 */
/*
 * validate.h - Vulkan's valid-usage rules that can be decided from a request alone, each reported by its VUID and
 * place.
 *
 * Three steps, in the order in which things become known: the batch as a whole, one entry's fields (before any of its
 * memory is read), and the contents of the private canonical copy. Places look like
 * "infos[2].geometries[3].triangles.vertexStride", "ranges[2][3].primitiveOffset",
 * "infos[0].geometries[0].instances[17].flags". The first broken rule is reported. Pure functions.
 */
#ifndef BVHD_VALIDATE_H
#define BVHD_VALIDATE_H

#include <stdatomic.h>

#include "builder/format/canonical.h"
#include "proto/base/geometry.h"
#include "proto/base/request_limits.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"
#include "proto/base/validate_batch.h"

/*
 * Rules on the fields of one entry, `index` in its batch: types, flags, modes, options, formats, strides, alignments,
 * counts, presence of memory. Looks at no byte of the geometry's memory. Modes and flags that Vulkan knows and bvhd
 * does not do: BVHD_UNSUPPORTED.
 */
enum bvhd_status validate_input(const struct build_input *input, uint32_t index, const struct limits *limits,
                                struct bvhd_error *error);

/* The same, but gives up when *cancel is set: BVHD_CANCELLED. `cancel` may be NULL. */
enum bvhd_status validate_input_until(const struct build_input *input, uint32_t index, const struct limits *limits,
                                      const atomic_bool *cancel, struct bvhd_error *error);

/*
 * Rules on contents: AABB min <= max, invertible matrices and flags of active instances (flags of inactive ones too).
 * Indices are checked while they are fetched (prepare.h). `cancel` may be NULL; BVHD_CANCELLED.
 */
enum bvhd_status validate_canonical(const struct canonical *canonical, uint32_t index, const atomic_bool *cancel,
                                    struct bvhd_error *error);

/* The same rules as a yes or no, over a run of boxes (six floats each) or canonical instance records. */
bool validate_boxes(const float *boxes, uint64_t count);
bool validate_instances(const unsigned char *records, uint64_t count);

/*
 * 3x3 part of a row-major 3x4 matrix is invertible in double precision: its determinant is finite and over 2^-48 of
 * what it would be if no products cancelled. Below that it is rounding, and so would be the rays that are taken to
 * object space.
 */
bool validate_invertible(const float matrix[12]);

#endif
