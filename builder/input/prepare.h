/* SPDX-License-Identifier: Apache-2.0 */
/*
 * prepare.h - the first step of a build: one pass over what the caller sent, into a private canonical copy.
 *
 * Every byte that the description's struct bytes lead to is read at most once, so that a caller who writes there
 * meanwhile harms only its own result: whatever was read is what is validated, hashed and built. (The description
 * itself, its geometries and references are the callee's to read and do not change.) Checks: validate_input, then
 * indices against maxVertex (10774, 10775) and against the bytes given, instance references against the table (03779),
 * then validate_canonical.
 *
 * What is reduced, beside what canonical.h says: a vertex stride of 0 keeps one vertex, whatever the indices say; a
 * transform that equals the identity is none; a box with a NaN anywhere gets a NaN minimum x, which makes it inactive;
 * other matrices are applied in double and rounded once, and NaNs among the results are all the same NaN.
 */
#ifndef BVHD_PREPARE_H
#define BVHD_PREPARE_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "proto/base/geometry.h"
#include "proto/base/request_limits.h"

/*
 * `index`: the entry's place in its batch, for errors. On success *ret_canonical owns its memory (context->memory),
 * until prepare_finish. The same bytes for any number of threads. BVHD_CANCELLED. BVHD_TOO_LARGE when the copy would
 * pass limits->max_canonical_bytes or 2^32 - 1 vertices.
 */
enum bvhd_status prepare(const struct build_input *input, uint32_t index, const struct limits *limits,
                         const struct build_context *context, struct canonical *ret_canonical,
                         struct bvhd_error *error);

/* Frees what prepare or prepare_open made. NULL-safe, idempotent for a zeroed view. */
void prepare_finish(struct canonical *canonical, struct memory *memory);

/*
 * Opens canonical bytes from elsewhere, hostile: checks every table, offset, index, and validate_canonical's rules. The
 * block must be 16-byte aligned and outlive the view; the view's tables are allocated from `memory` and freed by
 * prepare_finish, the block is not. BVHD_INCOMPATIBLE for another version, BVHD_CORRUPT with the field for bytes that
 * prepare would not have written.
 */
enum bvhd_status prepare_open(struct bytes block, struct memory *memory, struct canonical *ret_canonical,
                              struct bvhd_error *error);

#endif
