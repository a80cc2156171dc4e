/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_tree.h - cuts the tree of a lavapipe structure that is updated into tasks. Nodes are not trusted; what is
 * read leads nowhere outside the structure.
 */
#ifndef BVHD_LAVAPIPE_TREE_H
#define BVHD_LAVAPIPE_TREE_H

#include "builder/format/lavapipe.h"
#include "builder/update/subtrees.h"

/* Returns box node `index`. */
struct lavapipe_box lavapipe_tree_box(const struct lavapipe_view *view, uint32_t index);

/*
 * Returns the number of the box node that a reference leads to, or LAVAPIPE_NONE if it leads to none in (node, end),
 * where the descendants of `node` are.
 */
uint32_t lavapipe_tree_child(uint32_t reference, uint32_t node, uint32_t end);

/* Returns the leaf that a reference of this kind leads to, or LAVAPIPE_NONE if there is no such leaf. */
uint32_t lavapipe_tree_leaf(const struct lavapipe_view *view, uint32_t reference, enum lavapipe_kind kind,
                            uint32_t leaf_count);

/* Returns how many box nodes the structure has room for; the tree is over the first of them. */
uint32_t lavapipe_tree_room(const struct lavapipe_view *view);

/* Returns how many box nodes the tree has, if it is in depth-first order. */
uint32_t lavapipe_tree_count(const struct lavapipe_view *view);

/*
 * Cuts a tree of `count` box nodes into parts. Returns false if it finds nodes that are not in depth-first order; it
 * looks at the nodes above the parts alone.
 */
bool lavapipe_tree_cut(const struct lavapipe_view *view, uint32_t count, struct subtrees *subtrees);

#endif
