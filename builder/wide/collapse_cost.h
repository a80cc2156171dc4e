/* SPDX-License-Identifier: Apache-2.0 */
/*
 * collapse_cost.h - the table behind collapse.h: for each node of an ir, what its subtree costs as a forest of at most
 * 1, 2, ... 7 wide trees (Ylitie 2017, section 4.1), and the lookups that turn the table into decisions.
 *
 * With C(n, i) for node n as at most i trees, l and r its children:
 *   C(n, 1) = min(leaf(n), area(n) + D(n, 8))    C(n, i) = min(C(n, 1), D(n, i))    D(n, i) = min over k of C(l, k) + C(r, i - k)
 * C never rises with i. Areas are relative to the root's, so that they fit floats at any magnitude of the scene; where
 * the root has none, lengths stand in for areas.
 */
#ifndef BVHD_COLLAPSE_COST_H
#define BVHD_COLLAPSE_COST_H

#include "builder/wide/collapse.h"

enum { COLLAPSE_BUDGETS = 7 };

/*
 * A wide node costs its area, plus this share of the root's area divided by the number of refs (and one). It breaks
 * ties among nodes without area, and fills nodes better where that costs next to nothing: over real scenes 6 % fewer
 * nodes at 0.05 % more area.
 */
#define COLLAPSE_NODE_SHARE 2.0

/*
 * Rows are made in two steps: collapse_cost_of gives D(n, 2 .. 8) and the refs below n; the row of n's parent turns
 * them into what n is worth, which takes n's own box. So each row reads one pair of siblings, which are neighbours in
 * memory, and rows can be made in the order of memory.
 */
struct collapse_cost {
    float as[COLLAPSE_BUDGETS]; /* as[i - 1] is C(n, i); before: D(n, i + 1) */
    uint32_t leaf_refs; /* refs of the node where C(n, 1) is a leaf, else 0; before: refs below it */
};

_Static_assert(sizeof(struct collapse_cost) == 32, "two stores of 4 lanes");

/* Rows are those of inner nodes; what a leaf of the ir costs is computed when it is asked for. */
struct collapse_table {
    const struct ir *ir;
    uint32_t leaf_max;
    unsigned order_rounds; /* octants.h */
    float leaf_cost;
    float node_cost; /* added for each wide node: what one more of them is worth, as a share of the root's area */
    float scale; /* a power of two that brings the root to about unit size */
    float inverse; /* of the root's scaled area */
    bool lengths; /* the root has no area, or next to none */
    uint32_t *counts; /* refs below each inner node; 0 for one whose row has not been made */
    struct collapse_cost *costs;
};

/*
 * The row of an inner node: the number of its pair of children. Siblings are adjacent and all nodes but the root are
 * siblings, so pairs begin at odd indices.
 */
static inline uint32_t collapse_row(const struct ir *ir, uint32_t inner)
{
    return ir->nodes[inner].first / 2;
}

/* How many rows a tree has. */
static inline uint32_t collapse_rows(const struct ir *ir)
{
    return ir->node_count / 2;
}

/* Refs below a node. */
static inline uint32_t collapse_count(const struct collapse_table *table, uint32_t node)
{
    const struct ir_node *n = &table->ir->nodes[node];
    return n->count ? n->count : table->counts[n->first / 2];
}

/* Fills leaf_max, the costs and the measure from the root; `ir` has nodes. */
void collapse_table_init(struct collapse_table *table, const struct ir *ir, const struct collapse_options *options);

/*
 * Makes a row from the pair of siblings that it stands for, and ends those of the two. These must have been made; 2 *
 * row + 1 and 2 * row + 2 are the siblings.
 */
void collapse_cost_of(const struct collapse_table *table, uint32_t row);

/* The same, to the bit, as fast as this machine can. */
typedef void collapse_cost_function(const struct collapse_table *table, uint32_t row);
collapse_cost_function *collapse_cost_avx2(void);

/* Ends row 0, the root's, when all have been made. */
void collapse_cost_end(const struct collapse_table *table);

/*
 * The children of the wide node for `node` of the ir: at most WIDE_ARITY, in the order of the ir. Returns how many. A
 * leaf is its own only child.
 */
unsigned collapse_children(const struct collapse_table *table, uint32_t node,
                           struct wide_child ret_children[WIDE_ARITY]);

#endif
