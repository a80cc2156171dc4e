/* SPDX-License-Identifier: Apache-2.0 */
/*
 * collapse_emit.h - lays out the wide tree that a cost table decides on, in the order that wide.h states.
 *
 * The order is depth first: when a node is visited, its inner children get one block of adjacent places, and then each
 * child's subtree follows in slot order. So the nodes of a subtree below its root are contiguous, and subtrees can be
 * laid out separately and copied into place.
 */
#ifndef BVHD_COLLAPSE_EMIT_H
#define BVHD_COLLAPSE_EMIT_H

#include "builder/wide/collapse_cost.h"

/*
 * Lays out the tree. `table` is complete, and its ir has nodes. The caller ends *ret_wide with wide_finish. Returns
 * BVHD_NO_MEMORY or BVHD_CANCELLED.
 */
enum bvhd_status collapse_emit(const struct collapse_table *table, const atomic_bool *cancel, struct memory *memory,
                               const struct parallel *parallel, struct wide *ret_wide);

#endif
