/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cluster_tree.h - the tree of a piece while it is made by joining clusters: leaves first, of refs that follow each
 * other on a Morton curve, then inner nodes of any two that have no parent yet, by whatever method (ploc.h, binned.h);
 * in the end it is written as an ir.
 *
 * Nodes are refs: their boxes, and of inner ones the numbers of both children. Leaves come first, in the order of the
 * curve.
 */
#ifndef BVHD_CLUSTER_TREE_H
#define BVHD_CLUSTER_TREE_H

#include <stdatomic.h>

#include "builder/format/ir.h"
#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

struct cluster_request {
    struct primitive_ref *refs,
        *scratch; /* `count` each; what they hold afterwards is of no use. Refs may be runs (primitive.h) */
    uint32_t count; /* 1 .. 2^31 / 2; magnitudes are at most 2^40 */
    uint32_t leaf_max; /* 1 .. 31 primitives */
    float cut_cost; /* of cutting the curve into leaves (leaves.h) */
    bool fills_leaves; /* whatever fits into a leaf becomes one; otherwise what is no dearer as one by SAH */
    const atomic_bool *cancel; /* may be NULL; looked at every few thousand refs */
};

struct cluster_facts {
    float cost; /* SAH, undivided, of the subtree as it will be; 0 of inner nodes with fills_leaves */
    uint32_t refs : 31; /* primitives */
    uint32_t leaf : 1; /* all of them in one leaf */
};

struct cluster_tree {
    const struct cluster_request *request;
    struct primitive_ref *leaves, *inner;
    uint32_t leaf_count, node_count;
    uint32_t *ids; /* primitives of all leaves; a leaf's `id` says where its own begin, its `link` how many they are */
    struct cluster_facts *facts; /* of each node */
};

/* Joins all leaves to one node, whose number is *ret_root. BVHD_NO_MEMORY, BVHD_CANCELLED. */
typedef enum bvhd_status cluster_joiner(struct cluster_tree *tree, struct memory *memory, uint32_t *ret_root);

/*
 * Makes the leaves, has them joined, and writes the tree. *ret_ir is made by ir_init from `memory`; ret_depth,
 * ret_cost: its ir_depth, ir_cost. The same bytes on every machine. BVHD_NO_MEMORY, BVHD_CANCELLED.
 */
enum bvhd_status cluster_tree_build(const struct cluster_request *request, cluster_joiner *join, struct memory *memory,
                                    struct ir *ret_ir, uint32_t *ret_depth, double *ret_cost, struct bvhd_error *error);

static inline struct primitive_ref *cluster_tree_node(const struct cluster_tree *tree, uint32_t node)
{
    return node < tree->leaf_count ? &tree->leaves[node] : &tree->inner[node - tree->leaf_count];
}

/* In the number of a child: it becomes a leaf, whatever is below it. */
#define CLUSTER_BECOMES_LEAF UINT32_C(0x80000000)

static inline uint32_t cluster_as_child(const struct cluster_tree *tree, uint32_t node)
{
    return node | (uint32_t)tree->facts[node].leaf << 31;
}

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

static inline struct vec4_box cluster_box_of_two(const struct cluster_tree *tree, uint32_t left, uint32_t right)
{
    struct vec4_box box = vec4_box_load(cluster_tree_node(tree, left)),
                    other = vec4_box_load(cluster_tree_node(tree, right));
    vec4_box_grow(&box, other.min, other.max);
    return box;
}

/* Fills an inner node. The child with more refs becomes the first one. */
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

/* Makes the next node, above two without a parent; returns its number. */
static inline uint32_t cluster_tree_join(struct cluster_tree *tree, uint32_t left, uint32_t right)
{
    uint32_t node = tree->node_count++;
    cluster_tree_set(tree, node, left, right);
    return node;
}

#endif
