/* SPDX-License-Identifier: Apache-2.0 */
/*
 * depth.h - makes a binary tree shallower: rebuilds subtrees so that no leaf lies deeper than a limit, at the least
 * cost in quality.
 */
#ifndef BVHD_DEPTH_H
#define BVHD_DEPTH_H

#include <stdatomic.h>

#include "builder/format/ir.h"

/*
 * Brings the tree within `limit` levels (the root alone is one level), for layouts whose traversal stack is fixed.
 *
 * It rebuilds subtrees that reach below the limit, and of these the smallest ones that stay within the limit once they
 * are balanced. A rebuilt subtree is a balanced tree over its old leaves in the order of their refs. Refs and their
 * order do not change, and a rebuilt subtree uses the same entries of the array of nodes as before. A tree that fits is
 * not changed. *ret_depth is the number of levels afterwards. Takes O(n log n) for n nodes at worst. `cancel` may be
 * NULL.
 *
 * Returns BVHD_TOO_LARGE unless ceil(log2(leaves)) + 1 <= limit, BVHD_NO_MEMORY, or BVHD_CANCELLED. The tree is
 * unchanged after the first two, and must be thrown away after BVHD_CANCELLED.
 */
enum bvhd_status depth_limit(struct ir *ir, uint32_t limit, const atomic_bool *cancel, uint32_t *ret_depth,
                             struct bvhd_error *error);

#endif
