/* SPDX-License-Identifier: Apache-2.0 */
/*
 * prepare.h - the first step of a build: one pass over what the caller sent, into a private canonical copy.
 *
 * Every byte of the description's memory is read at most once, so that a caller who writes to it meanwhile harms only its own result:
 * whatever was read is what is validated, hashed and built. Checks: validate_input, then indices against maxVertex (10774, 10775) and
 * against the bytes given, then validate_canonical. A vertex stride of 0 keeps one vertex, whatever the indices say.
 */
#ifndef BVHD_PREPARE_H
#define BVHD_PREPARE_H

#include "canonical.h"
#include "geometry.h"
#include "limits.h"
#include "memory.h"
#include "parallel.h"

/* `index`: the entry's place in its batch, for errors. On success *ret_canonical owns its memory, until prepare_finish. */
enum bvhd_status prepare(const struct build_input *input, uint32_t index, const struct limits *limits, struct memory *memory,
                         const struct parallel *parallel, struct canonical *ret_canonical, struct bvhd_error *error);

/* Frees what prepare or prepare_open made. NULL-safe, idempotent for a zeroed view. */
void prepare_finish(struct canonical *canonical, struct memory *memory);

/*
 * Opens canonical bytes from elsewhere, hostile: checks every table, offset, index, and validate_canonical's rules. The block must be
 * 16-byte aligned and outlive the view; the view's tables are allocated from `memory` and freed by prepare_finish, the block is not.
 */
enum bvhd_status prepare_open(struct bytes block, struct memory *memory, struct canonical *ret_canonical, struct bvhd_error *error);

#endif
