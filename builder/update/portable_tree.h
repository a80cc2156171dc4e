/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_tree.h - reads the nodes of a portable structure that is updated: what each holds, how the tree is cut into
 * tasks, and what it costs. Nodes are not trusted; what is read leads nowhere outside the structure.
 */
#ifndef BVHD_PORTABLE_TREE_H
#define BVHD_PORTABLE_TREE_H

#include "builder/format/portable.h"
#include "builder/update/subtrees.h"

/* The children and records of one node. */
struct portable_shape {
    unsigned occupied; /* bit s: slot s is used */
    unsigned inner; /* bit s: by an inner child */
    unsigned records; /* in all leaves */
    uint8_t counts[8]; /* records in the leaf of each slot; 0 for inner children and empty slots */
};

/*
 * Reads node `node`, whose children must lie in (node, end). Returns false for a node that no writer has made: with
 * other children, without any, or with other records than those between its own first one and the next node's.
 */
bool portable_tree_read(const struct portable_view *view, uint32_t node, uint32_t end, struct portable_shape *ret);

/*
 * Cuts the tree. Returns false if the nodes are not in depth-first order, as far as the cut looks. `subtrees` is from
 * subtrees_init; there is at least one node.
 */
bool portable_tree_cut(const struct portable_view *view, struct subtrees *subtrees);

/*
 * Returns the sum over a node's children of area times price, where the records of a leaf cost `leaf_cost` each. The
 * area of a child of a structure that moves is the sum of those at t = 0 and at t = 1.
 */
double portable_tree_node_cost(const struct portable_node *node, bool moves, const struct portable_shape *shape,
                               double leaf_cost);

/* Returns half the area of the box round the children of a node at t = 0, plus half that at t = 1. */
double portable_tree_moving_area(const struct portable_moving_node *node);

#endif
