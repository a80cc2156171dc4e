/* SPDX-License-Identifier: Apache-2.0 */
/* depth.h - a pass over an ir: no leaf deeper than a limit, at the least cost in quality. */
#ifndef BVHD_DEPTH_H
#define BVHD_DEPTH_H

#include <stdatomic.h>

#include "builder/format/ir.h"

/*
 * Rebuilds, balanced over their leaves in the order of their refs, the smallest subtrees that reach below `limit`
 * levels and are not so deep already that balance does not help. Needs ceil(log2(leaves)) + 1 <= limit, else
 * BVHD_TOO_LARGE. Refs and their order stay; nodes are moved within the places of the rebuilt subtrees. Does nothing to
 * a tree that fits. On failure the tree is as it was, but of no use after BVHD_CANCELLED (`cancel` may be NULL).
 * *ret_depth: levels afterwards. O(n log n) in nodes at worst.
 */
enum bvhd_status depth_limit(struct ir *ir, uint32_t limit, const atomic_bool *cancel, uint32_t *ret_depth,
                             struct bvhd_error *error);

#endif
