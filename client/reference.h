/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference.h - converts what is known of a bottom level between a result, bvhd.h's struct bvhd_reference and a
 * description's struct reference.
 *
 * Bounds whose bits are all 0 are not given. The bounds of a structure that is one point at the origin are written with
 * minima of -0, which tells them apart; a description has them as 0 again, so that both spellings make one key.
 */
#ifndef BVHD_REFERENCE_H
#define BVHD_REFERENCE_H

#include <bvhd/bvhd.h>

#include "proto/base/geometry.h"

/* Returns whether a structure moves. The bytes may be anything; those that are no structure do not move. */
bool reference_moves(struct bytes structure);

/* Returns whether the reference states bounds, rather than leave them to its key. */
bool reference_is_bounded(const struct bvhd_reference *reference);

/* Converts a reference as it is. */
struct reference reference_convert(const struct bvhd_reference *reference);

/* Returns what a result that is BVHD_OK says of its structure, which is a bottom level, for the given handle. */
struct reference reference_take(const struct bvhd_result *result, uint64_t handle);

/*
 * Returns BVHD_INVALID if the structure of a result that is BVHD_OK is a top level, or BVHD_CORRUPT if its bytes are no
 * serialized structure.
 */
enum bvhd_status reference_check_bottom(const struct bvhd_result *result, struct bvhd_error *error);

#endif
