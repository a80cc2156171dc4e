/* SPDX-License-Identifier: Apache-2.0 */
/*
 * validate.h - checks Vulkan's valid-usage rules that can be decided from a request alone, and reports a broken one by
 * its VUID and place.
 *
 * There are three steps, in the order in which things become known: the batch as a whole (validate_batch, in
 * proto/base), one entry's fields before any of its memory is read, and the contents of the private canonical copy.
 * Places look like "infos[2].geometries[3].triangles.vertexStride", "ranges[2][3].primitiveOffset" or
 * "infos[0].geometries[0].instances[17].flags". The first broken rule is reported. The functions have no side effects
 * and may be called from any thread.
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
#include "proto/base/validate_shape.h"

/*
 * Checks the fields of one entry, `index` in its batch: types, flags, modes, options, formats, strides, alignments,
 * counts and the presence of memory. Reads no byte of the geometry's memory. Returns BVHD_INVALID with the rule, or
 * BVHD_UNSUPPORTED for modes and flags that Vulkan knows and bvhd does not implement.
 */
enum bvhd_status validate_input(const struct build_input *input, uint32_t index, const struct limits *limits,
                                struct bvhd_error *error);

/* The same, but returns BVHD_CANCELLED when *cancel is set. `cancel` may be NULL. */
enum bvhd_status validate_input_until(const struct build_input *input, uint32_t index, const struct limits *limits,
                                      const atomic_bool *cancel, struct bvhd_error *error);

/*
 * Checks contents: AABB min <= max, invertible matrices of active instances, and the flags of all instances. Indices
 * are checked while they are fetched (prepare.h). `cancel` may be NULL. Returns BVHD_INVALID with the rule,
 * BVHD_UNSUPPORTED for flags about opacity micromaps, or BVHD_CANCELLED.
 */
enum bvhd_status validate_canonical(const struct canonical *canonical, uint32_t index, const atomic_bool *cancel,
                                    struct bvhd_error *error);

/*
 * Reports memory that is not given, or does not hold what the range of the geometry says: BVHD_INVALID with this rule.
 * `field`: the member with the memory; `contents`: what it should hold.
 */
enum bvhd_status validate_refuse_memory(const struct validate_subject *subject, enum bvhd_vuid vuid, const char *field,
                                        const struct bytes *memory, const char *contents);

/*
 * True when the 3x3 part of a row-major 3x4 matrix is invertible in double precision: its determinant is finite and
 * larger than 2^-48 of what it would be if no products cancelled. A smaller determinant consists of rounding errors,
 * and rays could not be transformed to object space with it.
 */
bool validate_invertible(const float matrix[12]);

#endif
