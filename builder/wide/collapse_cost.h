/* SPDX-License-Identifier: Apache-2.0 */
/*
 * collapse_cost.h - the cost table behind collapse.h: for each node of an ir, what its subtree costs as a forest of at
 * most 1, 2, ... 7 wide trees (Ylitie 2017, section 4.1), and the functions that turn the table into decisions.
 *
 * C(n, i) is the least cost of node n as at most i trees. With the children l and r of n:
 *
 *     C(n, 1) = min(leaf(n), area(n) + D(n, 8))
 *     C(n, i) = min(C(n, 1), D(n, i))
 *     D(n, i) = min over k of C(l, k) + C(r, i - k)
 *
 * C never rises with i. Areas are relative to the root's area, so that they fit floats at any magnitude of the scene;
 * where the root has no area, lengths replace areas.
 */
#ifndef BVHD_COLLAPSE_COST_H
#define BVHD_COLLAPSE_COST_H

#include "builder/wide/collapse.h"

enum { COLLAPSE_BUDGETS = 7 };

/*
 * A wide node costs its area, plus COLLAPSE_NODE_SHARE * (the root's area) / (the number of refs in the tree + 1). The
 * addition breaks ties among nodes without area, and fills nodes better where that costs almost nothing: over real
 * scenes it gives 6 % fewer nodes for 0.05 % more area.
 */
#define COLLAPSE_NODE_SHARE 2.0

/*
 * The row of one inner node n. It is filled in two steps: collapse_cost_of computes D(n, 2 .. 8) and the number of refs
 * below n; computing the row of n's parent turns these into C, which needs n's own box. So each step reads one pair of
 * siblings, which are adjacent in memory, and rows can be made in the order of memory.
 */
struct collapse_cost {
    float as[COLLAPSE_BUDGETS]; /* as[i - 1] is C(n, i); before the second step it is D(n, i + 1) */
    uint32_t leaf_refs; /* refs of the node if C(n, 1) is a leaf, else 0; before the second step, refs below the node */
};

_Static_assert(sizeof(struct collapse_cost) == 32, "two stores of 4 lanes");

/* The table. Only inner nodes have rows; the cost of a leaf of the ir is computed when it is needed. */
struct collapse_table {
    const struct ir *ir;
    uint32_t leaf_max;
    unsigned order_rounds; /* `rounds` of octants_assign */
    float leaf_cost;
    float node_cost; /* cost of each wide node beside its area, as a share of the root's area */
    float scale; /* a power of two that brings the root to about unit size */
    float inverse; /* 1 / the root's scaled area */
    bool lengths; /* use lengths for areas, because the root has no area, or almost none */
    uint32_t *counts; /* refs below each inner node; 0 while its row has not been made */
    struct collapse_cost *costs;
};

/*
 * Returns the row of an inner node: the number of its pair of children. Siblings are adjacent, and every node except
 * the root is a sibling, so pairs start at odd indices.
 */
static inline uint32_t collapse_row(const struct ir *ir, uint32_t inner)
{
    return ir->nodes[inner].first / 2;
}

/* Returns the number of rows of a tree. */
static inline uint32_t collapse_rows(const struct ir *ir)
{
    return ir->node_count / 2;
}

/* Returns the number of refs below a node whose row has been made. */
static inline uint32_t collapse_count(const struct collapse_table *table, uint32_t node)
{
    const struct ir_node *n = &table->ir->nodes[node];
    return n->count ? n->count : table->counts[n->first / 2];
}

/*
 * Sets everything except `counts` and `costs`, which the caller allocates with collapse_rows entries each. `ir` has
 * nodes.
 */
void collapse_table_init(struct collapse_table *table, const struct ir *ir, const struct collapse_options *options);

/*
 * Makes row `row` from its two siblings, the nodes 2 * row + 1 and 2 * row + 2, whose rows have been made, and
 * completes the rows of these two.
 */
void collapse_cost_of(const struct collapse_table *table, uint32_t row);

/* Returns the fastest version of collapse_cost_of for this machine; all versions give the same bits. */
typedef void collapse_cost_function(const struct collapse_table *table, uint32_t row);
collapse_cost_function *collapse_cost_avx2(void);

/* Completes row 0, the root's, when all rows have been made. */
void collapse_cost_end(const struct collapse_table *table);

/*
 * Returns how many children the wide node for `node` of the ir has, at most WIDE_ARITY, and fills them in the order of
 * the ir. A leaf is its own only child.
 */
unsigned collapse_children(const struct collapse_table *table, uint32_t node,
                           struct wide_child ret_children[WIDE_ARITY]);

#endif
