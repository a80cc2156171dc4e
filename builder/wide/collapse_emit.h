/* SPDX-License-Identifier: Apache-2.0 */
/*
 * collapse_emit.h - lays out the wide tree that a cost table decides on, in the order that wide.h states.
 *
 * Depth first: a node's inner children get one block of adjacent places when the node is visited, then each child's
 * subtree follows in slot order. So a subtree's nodes below its root are one contiguous run, and subtrees are laid out
 * apart and copied into place.
 */
#ifndef BVHD_COLLAPSE_EMIT_H
#define BVHD_COLLAPSE_EMIT_H

#include "builder/wide/collapse_cost.h"

/* `table` is complete and its ir has nodes. BVHD_NO_MEMORY, BVHD_CANCELLED. */
enum bvhd_status collapse_emit(const struct collapse_table *table, const atomic_bool *cancel, struct memory *memory,
                               const struct parallel *parallel, struct wide *ret_wide);

#endif
