/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/subtrees.h"

/* More tasks than threads, so that all threads end at about the same time; none so small that starting it counts. */
enum { TASKS = 128, LEAST_LIMIT = 128, MOST_LIMIT = 4096 };

void subtrees_init(struct subtrees *subtrees, uint32_t node_count, struct memory *memory)
{
    uint32_t limit = node_count / TASKS;
    limit = limit < LEAST_LIMIT ? LEAST_LIMIT : limit > MOST_LIMIT ? MOST_LIMIT : limit;
    *subtrees = (struct subtrees){.memory = memory, .node_count = node_count, .limit = limit};
}

void subtrees_finish(struct subtrees *subtrees)
{
    memory_free(subtrees->memory, subtrees->tops);
    memory_free(subtrees->memory, subtrees->ranges);
    subtrees->tops = NULL;
    subtrees->ranges = NULL;
}

/* Returns the array with room for one more, or NULL. */
static void *grow(struct memory *memory, void *array, uint32_t count, uint32_t *room, size_t size)
{
    if (count < *room)
        return array;
    uint32_t more = *room ? 2 * *room : 256;
    void *grown = memory_resize(memory, array, (uint64_t)more * size);
    if (grown)
        *room = more;
    return grown;
}

void subtrees_add_top(struct subtrees *subtrees, uint32_t node)
{
    uint32_t *tops =
        grow(subtrees->memory, subtrees->tops, subtrees->top_count, &subtrees->top_room, sizeof *subtrees->tops);
    if (tops) {
        subtrees->tops = tops;
        tops[subtrees->top_count++] = node;
    } else {
        subtrees->out_of_memory = true;
    }
}

void subtrees_add_range(struct subtrees *subtrees, uint32_t begin, uint32_t end)
{
    struct subtrees_range *ranges = grow(subtrees->memory, subtrees->ranges, subtrees->range_count,
                                         &subtrees->range_room, sizeof *subtrees->ranges);
    if (ranges) {
        subtrees->ranges = ranges;
        ranges[subtrees->range_count++] = (struct subtrees_range){begin, end};
    } else {
        subtrees->out_of_memory = true;
    }
}

struct sweep {
    const struct subtrees *subtrees;
    subtrees_visit visit;
    void *context;
    _Atomic uint32_t corrupt; /* the lowest corrupt node of all ranges; UINT32_MAX: none */
};

static void sweep_range(void *context, size_t index)
{
    struct sweep *sweep = context;
    const struct subtrees_range *range = &sweep->subtrees->ranges[index];
    for (uint32_t node = range->end; node-- > range->begin;) {
        if (sweep->visit(sweep->context, node, range->end))
            continue;
        uint32_t lowest = atomic_load_explicit(&sweep->corrupt, memory_order_relaxed);
        while (node < lowest && !atomic_compare_exchange_weak_explicit(&sweep->corrupt, &lowest, node,
                                                                       memory_order_relaxed, memory_order_relaxed))
            ;
        return;
    }
}

enum bvhd_status subtrees_sweep(const struct subtrees *subtrees, const struct build_context *context,
                                subtrees_visit visit, void *visit_context, uint32_t *ret_node)
{
    struct sweep sweep = {subtrees, visit, visit_context, UINT32_MAX};
    if (!parallel_for_until(context->parallel, context->cancel, subtrees->range_count, sweep_range, &sweep))
        return BVHD_CANCELLED;
    *ret_node = atomic_load_explicit(&sweep.corrupt, memory_order_relaxed);
    if (*ret_node != UINT32_MAX)
        return BVHD_CORRUPT;
    for (uint32_t i = subtrees->top_count; i-- > 0;) {
        *ret_node = subtrees->tops[i];
        if (parallel_cancelled_at(context->cancel, i))
            return BVHD_CANCELLED;
        if (!visit(visit_context, subtrees->tops[i], subtrees->node_count))
            return BVHD_CORRUPT;
    }
    return BVHD_OK;
}
