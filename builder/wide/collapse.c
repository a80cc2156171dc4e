/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/wide/collapse.h"

#include <inttypes.h>
#include <stdio.h>

#include "builder/wide/collapse_cost.h"
#include "builder/wide/collapse_emit.h"

/* Rows of the cost table that one task makes; what they touch stays in a core's cache. */
enum { TASK_ROWS = 2048 };

#define NO_ROW UINT32_C(0xffffffff)

struct collapsing {
    struct collapse_table table;
    collapse_cost_function *cost_of;
    const atomic_bool *cancel;
    /*
     * For each task, the highest of its rows that need rows of other tasks; such rows are linked downwards, through
     * leaf_refs.
     */
    uint32_t *late;
    _Atomic uint32_t largest_leaf;
};

static bool is_cancelled(const struct collapsing *c)
{
    return parallel_cancelled(c->cancel);
}

static enum bvhd_status check_leaves(const struct collapsing *c, struct bvhd_error *error)
{
    const struct ir *ir = c->table.ir;
    uint32_t node = 0;
    if (c->largest_leaf <= c->table.leaf_max)
        return BVHD_OK;
    while (ir->nodes[node].count <= c->table.leaf_max)
        node++;
    char where[32];
    snprintf(where, sizeof where, "ir.nodes[%" PRIu32 "]", node);
    return bvhd_error_set(error, BVHD_INTERNAL, where, "a leaf of %" PRIu32 " refs, but %" PRIu32 " are allowed",
                          ir->nodes[node].count, c->table.leaf_max);
}

static void raise_largest(struct collapsing *c, uint32_t leaf)
{
    uint32_t largest = atomic_load_explicit(&c->largest_leaf, memory_order_relaxed);
    while (leaf > largest && !atomic_compare_exchange_weak_explicit(&c->largest_leaf, &largest, leaf,
                                                                    memory_order_relaxed, memory_order_relaxed))
        ;
}

/* True when the rows of the children of both siblings belong to this task, and have been made. */
static inline bool is_ready(const struct collapse_table *table, uint32_t row, uint32_t end)
{
    const struct ir_node *pair = &table->ir->nodes[2 * row + 1];
    for (int side = 0; side < 2; side++) {
        uint32_t child = pair[side].first / 2;
        if (pair[side].count == 0 && (child >= end || table->counts[child] == 0))
            return false;
    }
    return true;
}

/*
 * Makes the rows of one task. Children follow their parents, so going backwards finds their rows made. Rows that need
 * another task's, and all rows above those, are left for make_late_rows; subtrees mostly lie together in memory, so
 * these are few.
 */
static void make_rows(void *context, size_t index)
{
    struct collapsing *c = context;
    const struct collapse_table *table = &c->table;
    size_t begin, end;
    parallel_chunk(index, TASK_ROWS, collapse_rows(table->ir), &begin, &end);
    uint32_t *link = &c->late[index], largest = 0;
    for (uint32_t row = (uint32_t)end; row-- > begin;) {
        const struct ir_node *pair = &table->ir->nodes[2 * row + 1];
        largest = pair[0].count > largest ? pair[0].count : largest;
        largest = pair[1].count > largest ? pair[1].count : largest;
        if (is_ready(table, row, (uint32_t)end)) {
            c->cost_of(table, row);
            continue;
        }
        table->counts[row] = 0;
        *link = row;
        link = &table->costs[row].leaf_refs;
    }
    *link = NO_ROW;
    raise_largest(c, largest);
}

static void make_late_rows(struct collapsing *c, size_t tasks)
{
    uint32_t step = 0;
    while (tasks-- > 0) {
        for (uint32_t row = c->late[tasks], next; row != NO_ROW; row = next) {
            if (++step % TASK_ROWS == 0 && is_cancelled(c))
                return;
            next = c->table.costs[row].leaf_refs;
            c->cost_of(&c->table, row);
        }
    }
}

static size_t task_count(const struct ir *ir)
{
    return parallel_chunks(TASK_ROWS, collapse_rows(ir));
}

static bool allocate(struct collapsing *c, struct memory *memory)
{
    const struct ir *ir = c->table.ir;
    c->table.costs = memory_array(memory, (uint64_t)collapse_rows(ir) + 1, sizeof *c->table.costs);
    c->table.counts = memory_array(memory, (uint64_t)collapse_rows(ir) + 1, sizeof *c->table.counts);
    c->late = memory_array(memory, task_count(ir) + 1, sizeof *c->late);
    return c->table.costs && c->table.counts && c->late;
}

static enum bvhd_status report_cancelled(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, "collapse", "cancelled");
}

static enum bvhd_status decide(struct collapsing *c, struct memory *memory, const struct parallel *parallel,
                               struct bvhd_error *error)
{
    const struct ir *ir = c->table.ir;
    size_t tasks = task_count(ir);
    if (!allocate(c, memory))
        return bvhd_error_no_memory(error, "collapse", "no memory for the costs of %" PRIu32 " nodes", ir->node_count);
    c->largest_leaf = ir->nodes[0].count;
    if (!parallel_for_until(parallel, c->cancel, tasks, make_rows, c))
        return report_cancelled(error);
    make_late_rows(c, tasks);
    if (is_cancelled(c))
        return report_cancelled(error);
    if (!ir_is_leaf(ir, 0))
        collapse_cost_end(&c->table);
    return check_leaves(c, error);
}

static void finish(struct collapsing *c, struct memory *memory)
{
    memory_free(memory, c->late);
    memory_free(memory, c->table.counts);
    memory_free(memory, c->table.costs);
}

enum bvhd_status collapse(const struct ir *ir, const struct collapse_options *options, struct memory *memory,
                          const struct parallel *parallel, struct wide *ret_wide, struct bvhd_error *error)
{
    if (ir->node_count == 0) {
        *ret_wide = (struct wide){.memory = memory};
        return BVHD_OK;
    }
    struct collapsing c = {.cost_of = collapse_cost_avx2(), .cancel = options->cancel, .largest_leaf = 0};
    collapse_table_init(&c.table, ir, options);
    enum bvhd_status status = decide(&c, memory, parallel, error);
    if (status == BVHD_OK) {
        status = collapse_emit(&c.table, options->cancel, memory, parallel, ret_wide);
        if (status != BVHD_OK)
            bvhd_error_set(error, status, "collapse", status == BVHD_CANCELLED ? "cancelled" : "wide nodes");
    }
    finish(&c, memory);
    return status;
}
