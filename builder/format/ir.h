/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ir.h - the tree in the middle: a layout-neutral binary BVH as index arrays.
 *
 * Builders make it, passes improve it, layouts write it. Invariants, checked by ir_check():
 *  - node 0 is the root when node_count > 0; an empty structure has no nodes. Siblings are adjacent: an inner node's children are
 *    `first` and `first + 1`, both greater than its own index. Every node but the root is the child of exactly one node.
 *  - a leaf holds refs[first .. first + count), count >= 1; leaves cover the refs array exactly, without overlap.
 *  - the refs below any node are contiguous in the refs array.
 *  - a node's box, per key, is finite and contains the boxes of its children; a leaf's box contains what its refs stand for (for a
 *    split reference: the part that the builder assigned to it).
 *  - a ref is a flat primitive id (canonical.h); a primitive appears at most once unless the builder split it.
 * Boxes are arrays over 1 or 2 motion keys.
 */
#ifndef BVHD_IR_H
#define BVHD_IR_H

#include <stdint.h>

#include "proto/base/box.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

enum { IR_MAX_KEYS = 2 };

struct ir_node {
    uint32_t first; /* inner: left child; leaf: first ref */
    uint32_t count; /* inner: 0; leaf: number of refs */
};

struct ir {
    uint32_t node_count;
    uint32_t ref_count;
    uint32_t key_count; /* 1 or 2 */
    struct ir_node *nodes;
    struct box *boxes[IR_MAX_KEYS]; /* boxes[key][node] */
    uint32_t *refs;
    struct memory *memory; /* where the arrays come from */
};

static inline bool ir_is_leaf(const struct ir *ir, uint32_t node)
{
    return ir->nodes[node].count != 0;
}

/* Allocates arrays for at most `nodes` nodes and `refs` references, counts 0. On failure nothing is held. */
enum bvhd_status ir_init(struct ir *ir, struct memory *memory, uint32_t nodes, uint32_t refs, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void ir_finish(struct ir *ir);

/*
 * Checks every invariant above. `primitive_boxes` may be NULL; else primitive_boxes[id] is each primitive's box (empty
 * for one that is not in the tree), leaf boxes must contain (or, with split references, intersect) them, and each
 * non-empty one must be referenced. BVHD_INTERNAL with the node in `where` when broken. O(nodes).
 */
enum bvhd_status ir_check(const struct ir *ir, uint32_t primitive_count, const struct box *primitive_boxes,
                          bool allow_split, struct memory *memory, struct bvhd_error *error);

/*
 * SAH cost with traversal = intersection = 1: sum over inner nodes of area, over leaves of area * count, divided by the
 * root's area; 0 for an empty tree and for a root without area.
 */
double ir_sah(const struct ir *ir);

/* The undivided sum over nodes [first, end). */
double ir_cost(const struct ir *ir, uint32_t first, uint32_t end);

/*
 * Levels of the tree: 0 when empty, 1 for a root that is a leaf; IR_DEPTH_UNKNOWN when `memory` does not give 4 bytes a
 * node.
 */
#define IR_DEPTH_UNKNOWN UINT32_MAX
uint32_t ir_depth(const struct ir *ir, struct memory *memory);

/*
 * The same for a tree that is not empty, with ret_levels[node_count] from the caller: the level of each node, 1 for the
 * root.
 */
uint32_t ir_levels(const struct ir *ir, uint32_t *ret_levels);

#endif
