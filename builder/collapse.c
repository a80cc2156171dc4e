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
    uint32_t *roots; /* of subtrees of at most GRAIN refs, every node of which is in one task */
    uint32_t *groups; /* task i: roots[groups[i]] .. roots[groups[i + 1] - 1] */
    uint32_t root_count, group_count;
};

static bool is_top(const struct collapsing *c, uint32_t node)
{
    return c->counts[node] > GRAIN;
}

/* Children follow their parents, so counting backwards finds them done. */
static enum bvhd_status count_refs(const struct ir *ir, uint32_t leaf_max, uint32_t *counts, uint32_t *ret_tops,
                                   struct bvhd_error *error)
{
    uint32_t tops = 0;
    for (uint32_t i = ir->node_count; i-- > 0;) {
        const struct ir_node *node = &ir->nodes[i];
        uint32_t count = node->count ? node->count : counts[node->first] + counts[node->first + 1];
        if (node->count > leaf_max) {
            char where[32];
            snprintf(where, sizeof where, "ir.nodes[%" PRIu32 "]", i);
            return bvhd_error_set(error, BVHD_INTERNAL, where, "a leaf of %" PRIu32 " refs, but %" PRIu32 " are allowed", count,
                                  leaf_max);
        }
        counts[i] = count;
        tops += count > GRAIN;
    }
    *ret_tops = tops;
    return BVHD_OK;
}

static void add_root(struct collapsing *c, uint32_t node, uint32_t *refs)
{
    if (*refs == 0)
        c->groups[c->group_count++] = c->root_count;
    c->roots[c->root_count++] = node;
    *refs += c->counts[node];
    if (*refs >= GRAIN / 2)
        *refs = 0;
}

/* Each top node's children that are not at the top themselves, gathered to groups of about even size. */
static void gather_roots(struct collapsing *c)
{
    const struct ir *ir = c->table.ir;
    uint32_t refs = 0;
    if (!is_top(c, 0))
        add_root(c, 0, &refs);
    for (uint32_t i = 0; i < ir->node_count; i++) {
        if (!is_top(c, i))
            continue;
        for (uint32_t child = ir->nodes[i].first; child < ir->nodes[i].first + 2; child++)
            if (!is_top(c, child))
                add_root(c, child, &refs);
    }
    c->groups[c->group_count] = c->root_count;
}

/* A subtree of n refs has at most 2n - 1 nodes. Parents first in the list, so it is worked off backwards. */
static void cost_subtree(const struct collapsing *c, uint32_t root)
{
    uint32_t list[2 * GRAIN], count = 0;
    list[count++] = root;
    for (uint32_t i = 0; i < count; i++) {
        const struct ir_node *node = &c->table.ir->nodes[list[i]];
        if (node->count)
            continue;
        list[count++] = node->first;
        list[count++] = node->first + 1;
    }
    while (count > 0)
        collapse_cost_of(&c->table, list[--count]);
}

static void cost_group(void *context, size_t index)
{
    const struct collapsing *c = context;
    if (c->cancel && atomic_load_explicit(c->cancel, memory_order_relaxed))
        return;
    for (uint32_t i = c->groups[index]; i < c->groups[index + 1]; i++)
        cost_subtree(c, c->roots[i]);
}

static void cost_tops(const struct collapsing *c)
{
    for (uint32_t i = c->table.ir->node_count; i-- > 0;)
        if (is_top(c, i))
            collapse_cost_of(&c->table, i);
}

static bool allocate_lists(struct collapsing *c, uint32_t tops, struct memory *memory)
{
    c->table.costs = memory_array(memory, c->table.ir->node_count, sizeof *c->table.costs);
    c->roots = memory_array(memory, (uint64_t)tops + 1, sizeof *c->roots);
    c->groups = memory_array(memory, (uint64_t)tops + 2, sizeof *c->groups);
    return c->table.costs && c->roots && c->groups;
}

static bool is_cancelled(const struct collapsing *c)
{
    return c->cancel && atomic_load_explicit(c->cancel, memory_order_relaxed);
}

static enum bvhd_status decide(struct collapsing *c, const struct collapse_options *options, struct memory *memory,
                               const struct parallel *parallel, struct bvhd_error *error)
{
    const struct ir *ir = c->table.ir;
    uint32_t tops = 0;
    c->counts = memory_array(memory, ir->node_count, sizeof *c->counts);
    if (!c->counts)
        return bvhd_error_set(error, BVHD_NO_MEMORY, "collapse", "counts of %" PRIu32 " nodes", ir->node_count);
    enum bvhd_status status = count_refs(ir, options->leaf_max, c->counts, &tops, error);
    if (status != BVHD_OK)
        return status;
    c->table.counts = c->counts;
    if (!allocate_lists(c, tops, memory))
        return bvhd_error_set(error, BVHD_NO_MEMORY, "collapse", "costs of %" PRIu32 " nodes", ir->node_count);
    gather_roots(c);
    parallel_for(parallel, c->group_count, cost_group, c);
    if (is_cancelled(c))
        return bvhd_error_set(error, BVHD_CANCELLED, "collapse", "cancelled");
    cost_tops(c);
    return BVHD_OK;
}

static void finish(struct collapsing *c, struct memory *memory)
{
    memory_free(memory, c->groups);
    memory_free(memory, c->roots);
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
