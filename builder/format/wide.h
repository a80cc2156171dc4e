/* SPDX-License-Identifier: Apache-2.0 */
/*
 * wide.h - the 8-wide tree over an ir: which of the ir's boxes are the up to 8 children of each wide node, in the order
 * in which a layout writes them. Node i of a layout is wide node i.
 *
 * Node 0 is the root (count 0 for an empty structure). Slots are octants: the child in slot s lies towards +x if bit 0
 * of s is set, +y for bit 1, +z for bit 2, as far as all children together allow (octants.h); slots may be empty. The
 * inner children of a node are adjacent in the array, in slot order, from first_child on, and follow their parent:
 * first_child > index. The refs of a node's leaf children are written adjacently, in slot order, from first_leaf on.
 * Those blocks follow each other in node order, so that first_leaf of node i + 1 is first_leaf of node i plus the
 * number of refs of node i's leaf children. The order is depth first: a block of inner children, then the subtree of
 * each.
 */
#ifndef BVHD_WIDE_H
#define BVHD_WIDE_H

#include <stdint.h>

#include "proto/base/memory.h"

enum { WIDE_ARITY = 8, WIDE_NONE = 0 };

/*
 * A leaf child covers refs[first_ref .. first_ref + ref_count) of the ir; an inner child has ref_count 0. An ir of one
 * leaf gives one wide node with one child, which has node 0 and a ref_count. An empty slot is all zeros.
 */
struct wide_child {
    uint32_t node; /* the ir's box that bounds the child; WIDE_NONE in an empty slot */
    uint32_t first_ref; /* leaves only */
    uint32_t ref_count; /* leaves: 1 .. leaf_max; inner: 0 */
};

enum wide_kind { WIDE_EMPTY, WIDE_INNER, WIDE_LEAF };

static inline enum wide_kind wide_kind(const struct wide_child *child)
{
    return child->ref_count ? WIDE_LEAF : child->node != WIDE_NONE ? WIDE_INNER : WIDE_EMPTY;
}

/* A node with up to 8 children. */
struct wide_node {
    uint32_t node; /* the ir node that it replaces; 0 if the ir consists of boxes and refs alone, joined from pieces */
    uint32_t first_child; /* wide index of the first inner child; 0 if it has none */
    uint32_t first_leaf; /* see above */
    struct wide_child slots[WIDE_ARITY];
};

/* A wide tree; wide_finish() frees its nodes. */
struct wide {
    uint32_t node_count;
    uint32_t leaf_refs; /* number of refs over all leaf children */
    uint32_t depth; /* levels of wide nodes */
    struct wide_node *nodes;
    struct memory *memory;
};

/* Frees the nodes. NULL and repeated calls are allowed. */
void wide_finish(struct wide *wide);

#endif
