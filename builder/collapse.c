/* SPDX-License-Identifier: Apache-2.0 */
#include "collapse.h"

#include <inttypes.h>
#include <stdio.h>

#include "collapse_cost.h"
#include "collapse_emit.h"

/* The cost table is filled in tasks of about this many refs: what they touch stays in a core's cache. */
enum { GRAIN = 4096 };

struct collapsing {
    struct collapse_table table;
    const atomic_bool *cancel;
    uint32_t *counts;
    uint32_t *tops; /* nodes above them, parents first */
    uint32_t *roots; /* of subtrees of at most GRAIN refs, every node of which is in one task */
    uint32_t *groups; /* task i: roots[groups[i]] .. roots[groups[i + 1] - 1] */
    uint32_t top_count, root_count, group_count;
};

static bool is_top(const struct collapsing *c, uint32_t node)
{
    return collapse_count(&c->table, node) > GRAIN;
}

static bool is_cancelled(const struct collapsing *c)
{
    return parallel_cancelled(c->cancel);
}

/* Long loops look at the flag after so many steps. */
enum { STRIDE = 32768 };

static uint32_t largest_leaf(const struct ir *ir, const struct collapsing *c)
{
    uint32_t largest = 0;
    for (size_t begin = 0, end; begin < ir->node_count && !is_cancelled(c); begin = end) {
        parallel_chunk(begin / STRIDE, STRIDE, ir->node_count, &begin, &end);
        for (size_t i = begin; i < end; i++)
            largest = ir->nodes[i].count > largest ? ir->nodes[i].count : largest;
    }
    return largest;
}

static enum bvhd_status check_leaves(const struct collapsing *c, uint32_t leaf_max, struct bvhd_error *error)
{
    const struct ir *ir = c->table.ir;
    uint32_t node = 0;
    if (largest_leaf(ir, c) <= leaf_max)
        return BVHD_OK;
    while (ir->nodes[node].count <= leaf_max)
        node++;
    char where[32];
    snprintf(where, sizeof where, "ir.nodes[%" PRIu32 "]", node);
    return bvhd_error_set(error, BVHD_INTERNAL, where, "a leaf of %" PRIu32 " refs, but %" PRIu32 " are allowed", ir->nodes[node].count,
                          leaf_max);
}

/*
 * Children follow their parents, so counting backwards finds them done. Without branches on leaves: which nodes are leaves cannot be foreseen.
 * Returns how many nodes are tops.
 */
static uint32_t count_refs(struct collapsing *c)
{
    const struct ir *ir = c->table.ir;
    uint32_t tops = 0, *counts = c->counts;
    for (uint32_t row = collapse_rows(ir); row-- > 0;) {
        uint32_t sum = 0;
        if (row % STRIDE == 0 && is_cancelled(c))
            return 0;
        for (int k = 1; k <= 2; k++) {
            const struct ir_node *child = &ir->nodes[2 * row + k];
            uint32_t below = counts[child->count ? 0 : child->first / 2];
            sum += child->count ? child->count : below;
        }
        counts[row] = sum;
        tops += sum > GRAIN;
    }
    return tops;
}

static void add_root(struct collapsing *c, uint32_t node, uint32_t *refs)
{
    if (*refs == 0)
        c->groups[c->group_count++] = c->root_count;
    c->roots[c->root_count++] = node;
    *refs += collapse_count(&c->table, node);
    if (*refs >= GRAIN / 2)
        *refs = 0;
}

/* Below the top nodes there is a root for each child that is none; roots are gathered to groups of about even size. */
static void gather_roots(struct collapsing *c)
{
    const struct ir *ir = c->table.ir;
    uint32_t refs = 0;
    if (is_top(c, 0))
        c->tops[c->top_count++] = 0;
    else
        add_root(c, 0, &refs);
    for (uint32_t i = 0; i < c->top_count; i++) {
        uint32_t first = ir->nodes[c->tops[i]].first;
        for (uint32_t child = first; child < first + 2; child++) {
            if (is_top(c, child))
                c->tops[c->top_count++] = child;
            else
                add_root(c, child, &refs);
        }
    }
    c->groups[c->group_count] = c->root_count;
}

/*
 * Lists a subtree's inner nodes depth first, which is about their order in memory, parents before children, and works the list off backwards.
 * The list grows from one end of the array, the stack from the other; a subtree of n refs has at most n - 1 inner nodes.
 */
static void cost_subtree(const struct collapsing *c, uint32_t root)
{
    const struct ir *ir = c->table.ir;
    uint32_t nodes[GRAIN], count = 0, top = GRAIN;
    if (!ir_is_leaf(ir, root))
        nodes[--top] = root;
    while (top < GRAIN) {
        uint32_t node = nodes[top++], first = ir->nodes[node].first;
        nodes[count++] = node;
        if (!ir_is_leaf(ir, first + 1))
            nodes[--top] = first + 1;
        if (!ir_is_leaf(ir, first))
            nodes[--top] = first;
    }
    while (count > 0)
        collapse_cost_of(&c->table, nodes[--count]);
}

static void cost_group(void *context, size_t index)
{
    const struct collapsing *c = context;
    for (uint32_t i = c->groups[index]; i < c->groups[index + 1]; i++)
        cost_subtree(c, c->roots[i]);
}

static bool allocate_lists(struct collapsing *c, uint32_t tops, struct memory *memory)
{
    c->table.costs = memory_array(memory, (uint64_t)collapse_rows(c->table.ir) + 1, sizeof *c->table.costs);
    c->tops = memory_array(memory, (uint64_t)tops + 1, sizeof *c->tops);
    c->roots = memory_array(memory, (uint64_t)tops + 1, sizeof *c->roots);
    c->groups = memory_array(memory, (uint64_t)tops + 2, sizeof *c->groups);
    return c->table.costs && c->tops && c->roots && c->groups;
}

static enum bvhd_status report_cancelled(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, "collapse", "cancelled");
}

/* Refs below each node, and the lists of nodes. */
static enum bvhd_status count(struct collapsing *c, struct memory *memory, struct bvhd_error *error)
{
    const struct ir *ir = c->table.ir;
    c->counts = memory_array(memory, (uint64_t)collapse_rows(ir) + 1, sizeof *c->counts);
    if (!c->counts)
        return bvhd_error_set(error, BVHD_NO_MEMORY, "collapse", "counts of %" PRIu32 " nodes", ir->node_count);
    c->table.counts = c->counts;
    c->counts[0] = 0;
    uint32_t tops = count_refs(c);
    if (is_cancelled(c))
        return report_cancelled(error);
    if (!allocate_lists(c, tops, memory))
        return bvhd_error_set(error, BVHD_NO_MEMORY, "collapse", "costs of %" PRIu32 " nodes", ir->node_count);
    gather_roots(c);
    return BVHD_OK;
}

static enum bvhd_status decide(struct collapsing *c, const struct collapse_options *options, struct memory *memory,
                               const struct parallel *parallel, struct bvhd_error *error)
{
    enum bvhd_status status = check_leaves(c, options->leaf_max, error);
    if (status == BVHD_OK)
        status = count(c, memory, error);
    if (status != BVHD_OK)
        return status;
    if (!parallel_for_until(parallel, c->cancel, c->group_count, cost_group, c))
        return report_cancelled(error);
    while (c->top_count > 0)
        collapse_cost_of(&c->table, c->tops[--c->top_count]);
    return BVHD_OK;
}

static void finish(struct collapsing *c, struct memory *memory)
{
    memory_free(memory, c->groups);
    memory_free(memory, c->roots);
    memory_free(memory, c->tops);
    memory_free(memory, c->table.costs);
    memory_free(memory, c->counts);
}

enum bvhd_status collapse(const struct ir *ir, const struct collapse_options *options, struct memory *memory,
                          const struct parallel *parallel, struct wide *ret_wide, struct bvhd_error *error)
{
    if (ir->node_count == 0) {
        *ret_wide = (struct wide){.memory = memory};
        return BVHD_OK;
    }
    struct collapsing c = {.cancel = options->cancel};
    collapse_table_init(&c.table, ir, options);
    enum bvhd_status status = decide(&c, options, memory, parallel, error);
    if (status == BVHD_OK) {
        status = collapse_emit(&c.table, options->cancel, memory, parallel, ret_wide);
        if (status != BVHD_OK)
            bvhd_error_set(error, status, "collapse", status == BVHD_CANCELLED ? "cancelled" : "wide nodes");
    }
    finish(&c, memory);
    return status;
}
