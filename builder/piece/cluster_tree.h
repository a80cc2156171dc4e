/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cluster_tree.h - the tree of a piece while it is made by joining clusters. Leaves come first: refs that follow each
 * other on a Morton curve. Then a method (ploc.h, binned.h) joins nodes without a parent, two at a time, by inner
 * nodes, until one is left. At the end the tree is written as an ir.
 *
 * Nodes are stored as refs: a box, and for an inner node the numbers of both children. The leaves are the first nodes,
 * in the order of the curve. One thread builds a tree.
 */
#ifndef BVHD_CLUSTER_TREE_H
#define BVHD_CLUSTER_TREE_H

#include <stdatomic.h>

#include "builder/format/ir.h"
#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

struct cluster_request {
    /* `count` refs each; their contents afterwards have no meaning. Refs may be runs (primitive.h). */
    struct primitive_ref *refs, *scratch;
    uint32_t count; /* 1 .. 2^30; magnitudes are at most 2^40 */
    uint32_t leaf_max; /* primitives of a leaf; 1 .. 31 */
    float cut_cost; /* cost of a cut between two leaves (leaves.h) */
    /* true: make a leaf of everything that fits into one; false: only of what costs no more as a leaf, by SAH */
    bool fills_leaves;
    const atomic_bool *cancel; /* may be NULL; checked every few thousand refs */
};

struct cluster_facts {
    /*
     * SAH cost, not divided by the root's area, of the subtree as it will be written; 0 for inner nodes with
     * fills_leaves
     */
    float cost;
    uint32_t refs : 31; /* number of primitives */
    uint32_t leaf : 1; /* they become one leaf */
};

struct cluster_tree {
    const struct cluster_request *request;
    struct primitive_ref *leaves, *inner;
    uint32_t leaf_count, node_count;
    /* primitives of all leaves; those of a leaf are ids[id .. id + link), with `id` and `link` of its ref */
    uint32_t *ids;
    struct cluster_facts *facts; /* one for each node */
};

/* Joins all leaves into one node, whose number is *ret_root. Returns BVHD_NO_MEMORY or BVHD_CANCELLED. */
typedef enum bvhd_status cluster_joiner(struct cluster_tree *tree, struct memory *memory, uint32_t *ret_root);

/*
 * Makes the leaves, calls `join`, and writes the tree. *ret_ir is allocated from `memory`, and the caller ends it with
 * ir_finish; *ret_depth and *ret_cost are its ir_depth and ir_cost. The result is the same on every machine. Returns
 * BVHD_NO_MEMORY or BVHD_CANCELLED.
 */
enum bvhd_status cluster_tree_build(const struct cluster_request *request, cluster_joiner *join, struct memory *memory,
                                    struct ir *ret_ir, uint32_t *ret_depth, double *ret_cost, struct bvhd_error *error);

/* Returns the ref of a node. */
static inline struct primitive_ref *cluster_tree_node(const struct cluster_tree *tree, uint32_t node)
{
    return node < tree->leaf_count ? &tree->leaves[node] : &tree->inner[node - tree->leaf_count];
}

/* Bit in the number of a child: the child becomes a leaf, whatever is below it. */
#define CLUSTER_BECOMES_LEAF UINT32_C(0x80000000)

/* Returns the node's number, with CLUSTER_BECOMES_LEAF where it applies. */
static inline uint32_t cluster_as_child(const struct cluster_tree *tree, uint32_t node)
{
    return node | (uint32_t)tree->facts[node].leaf << 31;
}

/*
 * Returns the facts of a node that has this box, and two children with these facts. It becomes a leaf if it has at most
 * leaf_max primitives and, without fills_leaves, costs no more as a leaf.
 */
static inline struct cluster_facts cluster_facts_of(const struct cluster_tree *tree, struct cluster_facts left,
                                                    struct cluster_facts right, struct vec4_box box)
{
    const uint32_t refs = (uint32_t)left.refs + right.refs, leaf_max = tree->request->leaf_max;
    if (tree->request->fills_leaves)
        return (struct cluster_facts){0, refs & INT32_MAX, refs <= leaf_max};
    float area = vec4_box_half_area(box), cost = area + left.cost + right.cost, as_leaf = area * (float)refs;
    bool leaf = refs <= leaf_max && as_leaf <= cost;
    return (struct cluster_facts){leaf ? as_leaf : cost, refs & INT32_MAX, leaf};
}

/* Returns the common box of two nodes. */
static inline struct vec4_box cluster_box_of_two(const struct cluster_tree *tree, uint32_t left, uint32_t right)
{
    struct vec4_box box = vec4_box_load(cluster_tree_node(tree, left)),
                    other = vec4_box_load(cluster_tree_node(tree, right));
    vec4_box_grow(&box, other.min, other.max);
    return box;
}

/* Fills an inner node. The child with more primitives becomes the first one. */
static inline void cluster_tree_set(struct cluster_tree *tree, uint32_t node, uint32_t left, uint32_t right)
{
    const uint32_t children[2] = {cluster_as_child(tree, left), cluster_as_child(tree, right)};
    const struct cluster_facts of_left = tree->facts[left], of_right = tree->facts[right];
    const bool in_order = of_left.refs >= of_right.refs;
    const struct vec4_box box = cluster_box_of_two(tree, left, right);
    struct primitive_ref *ref = &tree->inner[node - tree->leaf_count];
    vec4_box_store(ref, box);
    ref->link = children[!in_order];
    ref->id = children[in_order];
    tree->facts[node] = cluster_facts_of(tree, of_left, of_right, box);
}

/* Makes the next node above two nodes without a parent, and returns its number. */
static inline uint32_t cluster_tree_join(struct cluster_tree *tree, uint32_t left, uint32_t right)
{
    uint32_t node = tree->node_count++;
    cluster_tree_set(tree, node, left, right);
    return node;
}

#endif
