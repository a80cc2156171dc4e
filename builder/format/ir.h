/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ir.h - the intermediate representation: a layout-neutral binary BVH as index arrays.
 *
 * Builders make it, passes improve it, layouts write it. Invariants, which ir_check() checks:
 * - Node 0 is the root if node_count > 0; an empty structure has no nodes. Siblings are adjacent: the children of an
 *   inner node are `first` and `first + 1`, both greater than its own index. Every node but the root is the child of
 *   exactly one node.
 * - A leaf holds refs[first .. first + count), count >= 1; the leaves cover the refs array exactly, without overlap.
 * - The refs below any node are contiguous in the refs array.
 * - A node's box, per key, is finite and contains the boxes of its children. A leaf's box contains the primitives of
 *   its refs (for a split reference: the part that the builder assigned to it).
 * - A ref is a flat primitive id (canonical.h). A primitive appears at most once unless the builder split it.
 *
 * There is one array of boxes for each of the 1 or 2 motion keys.
 */
#ifndef BVHD_IR_H
#define BVHD_IR_H

#include <stdint.h>

#include "proto/base/box.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

enum { IR_MAX_KEYS = 2 };

/* One node: inner nodes name their children, leaves their refs. */
struct ir_node {
    uint32_t first; /* inner: left child; leaf: first ref */
    uint32_t count; /* inner: 0; leaf: number of refs */
};

/* A tree. The arrays belong to it; ir_finish() frees them. */
struct ir {
    uint32_t node_count;
    uint32_t ref_count;
    uint32_t key_count; /* 1 or 2 */
    struct ir_node *nodes;
    struct box *boxes[IR_MAX_KEYS]; /* boxes[key][node] */
    uint32_t *refs;
    struct memory *memory; /* the budget that the arrays come from */
};

static inline bool ir_is_leaf(const struct ir *ir, uint32_t node)
{
    return ir->nodes[node].count != 0;
}

/*
 * Allocates arrays for at most `nodes` nodes and `refs` refs, and sets the counts to 0. On failure nothing stays
 * allocated.
 */
enum bvhd_status ir_init(struct ir *ir, struct memory *memory, uint32_t nodes, uint32_t refs, struct bvhd_error *error);

/* Frees the arrays. NULL and repeated calls are allowed. */
void ir_finish(struct ir *ir);

/*
 * Checks all invariants above in O(nodes). primitive_boxes[id] is each primitive's box, empty for one that is not in
 * the tree: leaf boxes must contain them (or intersect them, with split references), and each non-empty one must be
 * referenced. Those of the second key follow those of the first. `primitive_boxes` may be NULL. Returns BVHD_INTERNAL
 * with the node in `where` if an invariant is broken, and BVHD_NO_MEMORY.
 */
enum bvhd_status ir_check(const struct ir *ir, uint32_t primitive_count, const struct box *primitive_boxes,
                          bool allow_split, struct memory *memory, struct bvhd_error *error);

/*
 * Returns the SAH cost with traversal = intersection = 1: the sum of area over inner nodes and of area * count over
 * leaves, divided by the root's area, each area summed over all keys. It is 0 for an empty tree and for a root without
 * area.
 */
double ir_sah(const struct ir *ir);

/* Returns the same from that sum, undivided; of a tree without nodes only boxes are read. */
double ir_sah_from(const struct ir *ir, double cost);

/* Returns that sum over nodes [first, end), undivided. */
double ir_cost(const struct ir *ir, uint32_t first, uint32_t end);

/*
 * Returns the number of levels: 0 for an empty tree, 1 for a root that is a leaf, IR_DEPTH_UNKNOWN if `memory` cannot
 * provide 4 bytes per node.
 */
#define IR_DEPTH_UNKNOWN UINT32_MAX
uint32_t ir_depth(const struct ir *ir, struct memory *memory);

/* Does the same for a non-empty tree, and writes the level of each node (1 for the root) to ret_levels[node_count]. */
uint32_t ir_levels(const struct ir *ir, uint32_t *ret_levels);

#endif
