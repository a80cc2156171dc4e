/* SPDX-License-Identifier: Apache-2.0 */
/*
 * prepare.h - the first step of a build: reads what the caller sent once, and makes a private canonical copy of it.
 *
 * Every byte that the description's struct bytes point to is read at most once, so a caller who writes to that memory
 * during the build harms only its own result: the bytes that were read are the ones that are validated, hashed and
 * built. (The description itself, with its tables of geometries and references, must not change during the call.) The
 * rules are checked in this order: validate_input; indices against maxVertex (VUIDs 10774 and 10775) and against the
 * bytes given; instance references against the table (VUID 03779); validate_canonical.
 *
 * The copy is normalised, beyond what canonical.h says: strides of 0, of vertices and of radii if there are any, keep
 * one vertex (two equal ones of linear swept spheres), whatever the indices are; the pairs of a list of linear swept
 * spheres are gathered, each with vertices of its own, if not all second ends are the vertex after the first one; a
 * transform equal to the identity counts as none; a box with a NaN anywhere gets a NaN minimum x, which makes it
 * inactive; other matrices are applied in double and rounded once, and every NaN among the results is the same NaN.
 */
#ifndef BVHD_PREPARE_H
#define BVHD_PREPARE_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "proto/base/geometry.h"
#include "proto/base/request_limits.h"

/*
 * Makes the canonical copy. `index`: the entry's place in its batch, for errors. On success *ret_canonical owns its
 * memory (of context->memory) until prepare_finish; on failure nothing is held. The bytes are the same for any number
 * of threads.
 *
 * Returns BVHD_INVALID or BVHD_UNSUPPORTED with the rule and the place, BVHD_TOO_LARGE when the copy would exceed
 * limits->max_canonical_bytes or 2^32 - 1 vertices, BVHD_NO_MEMORY, or BVHD_CANCELLED.
 */
enum bvhd_status prepare(const struct build_input *input, uint32_t index, const struct limits *limits,
                         const struct build_context *context, struct canonical *ret_canonical,
                         struct bvhd_error *error);

/* Frees what prepare or prepare_open made, and zeroes the view. `canonical` may be NULL or already zeroed. */
void prepare_finish(struct canonical *canonical, struct memory *memory);

/*
 * Opens canonical bytes that come from elsewhere and are not trusted: checks every table, offset and index, and the
 * rules of validate_canonical. The block must be 16-byte aligned, must not change, and must outlive the view. The
 * view's tables are allocated from `memory` and freed by prepare_finish; the block is not. Returns BVHD_INCOMPATIBLE
 * for another version, BVHD_CORRUPT with the field for bytes that prepare would not have written, the errors of
 * validate_canonical, or BVHD_NO_MEMORY.
 */
enum bvhd_status prepare_open(struct bytes block, struct memory *memory, struct canonical *ret_canonical,
                              struct bvhd_error *error);

#endif
