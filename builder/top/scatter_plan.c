/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/scatter_plan.h"

#include <math.h>

#include "builder/top/sample_cut.h"

/* Parts of the sample with at least this many refs are worth another thread. */
enum { APART = 1024 };

/* A range of the sample that is still to be divided. */
struct sample_range {
    struct primitive_ref *refs;
    struct primitive_ref *spare; /* room for as many refs, for the root for twice as many; NULL: there is none */
    uint32_t node, count;
};

/* The plan while it is made: nodes are in the order in which threads make them, and pieces have no numbers yet. */
struct planning {
    struct scatter_node nodes[SCATTER_NODES_MAX];
    const struct parallel *parallel;
    uint32_t enough;
    _Atomic uint32_t node_count;
    atomic_bool full; /* more nodes were wanted than fit */
};

/* Returns false where no plane has refs on both sides, or there is no room for two more nodes. */
static bool split_range(struct planning *planning, const struct sample_range *range,
                        struct sample_range ret_children[2])
{
    const struct parallel *parallel = planning->parallel;
    struct primitive_ref *refs = range->refs, *spare = range->spare;
    struct sample_plane plane;
    uint32_t left;
    if (!sample_plane_find(refs, range->count, parallel, &plane))
        return false;
    if (spare && sample_is_large(range->count, parallel)) {
        left = sample_divide_into(refs, range->count, &plane, parallel, spare);
        refs = range->spare;
        spare = range->node == 0 ? spare + range->count : range->refs; /* the sample stays for plan_in_order */
    } else {
        left = sample_divide(refs, range->count, &plane);
    }
    if (left == 0 || left == range->count)
        return false;
    uint32_t child = atomic_fetch_add_explicit(&planning->node_count, 2, memory_order_relaxed);
    if (child + 2 > SCATTER_NODES_MAX) {
        atomic_store_explicit(&planning->full, true, memory_order_relaxed);
        return false;
    }
    planning->nodes[range->node] = (struct scatter_node){plane.threshold, plane.axis, child, 0};
    ret_children[0] = (struct sample_range){refs, spare, child, left};
    ret_children[1] = (struct sample_range){refs + left, spare ? spare + left : NULL, child + 1, range->count - left};
    return true;
}

/* Divides a range if it is large enough; otherwise it becomes a leaf. */
static bool go_on(struct planning *planning, const struct sample_range *range, struct sample_range ret_children[2])
{
    if (range->count > planning->enough && split_range(planning, range, ret_children))
        return true;
    planning->nodes[range->node] = (struct scatter_node){INFINITY, 0, range->node, 0};
    return false;
}

/*
 * Plans on one thread, left children first: where not all nodes fit, the result must not depend on the order in which
 * threads make them.
 */
static void plan_in_order(struct planning *planning, struct sample_range range)
{
    struct sample_range waiting[SCATTER_PIECES_MAX], children[2];
    uint32_t waiting_count = 0;
    for (;;) {
        if (go_on(planning, &range, children)) {
            waiting[waiting_count++] = children[1];
            range = children[0];
            continue;
        }
        if (waiting_count == 0)
            return;
        range = waiting[--waiting_count];
    }
}

struct branch {
    struct planning *planning;
    struct sample_range ranges[2];
};

static void plan_branch(void *context, size_t index);

/*
 * Plans both children in parallel where both are large; otherwise the smaller one first, so that calls nest only a few
 * levels deep.
 */
static void plan_range(struct planning *planning, struct sample_range range)
{
    struct branch branch = {.planning = planning};
    while (go_on(planning, &range, branch.ranges)) {
        bool left_first = branch.ranges[0].count <= branch.ranges[1].count;
        if (branch.ranges[!left_first].count >= APART) {
            parallel_for(planning->parallel, 2, plan_branch, &branch);
            return;
        }
        plan_range(planning, branch.ranges[!left_first]);
        range = branch.ranges[left_first];
    }
}

static void plan_branch(void *context, size_t index)
{
    const struct branch *branch = context;
    plan_range(branch->planning, branch->ranges[index]);
}

/* A node of the unordered plan, and its place in the result. */
struct placing {
    uint32_t from, to, level;
    struct scatter_cell cell;
};

/* Copies the nodes in the order of plan_in_order, and numbers the pieces. */
static void place(const struct scatter_node *nodes, struct scatter_plan *plan)
{
    struct placing waiting[SCATTER_PIECES_MAX], at = {0, 0, 0, {vec4_all(-INFINITY), vec4_all(INFINITY)}};
    uint32_t waiting_count = 0;
    plan->node_count = 1;
    plan->piece_count = plan->levels = 0;
    for (;;) {
        struct scatter_node *to = &plan->nodes[at.to];
        *to = nodes[at.from];
        if (to->child != at.from) {
            struct placing left = {to->child, plan->node_count, at.level + 1, at.cell}, right = left;
            right.from++, right.to++;
            left.cell.high[to->axis] = right.cell.low[to->axis] = to->threshold;
            to->child = plan->node_count;
            plan->node_count += 2;
            waiting[waiting_count++] = right;
            at = left;
            continue;
        }
        plan->cells[plan->piece_count] = at.cell;
        to->child = at.to;
        to->piece = plan->piece_count++;
        plan->levels = at.level > plan->levels ? at.level : plan->levels;
        if (waiting_count == 0)
            return;
        at = waiting[--waiting_count];
    }
}

void scatter_plan_make(struct primitive_ref *sample, struct primitive_ref *spare, uint32_t count, uint32_t enough,
                       const struct parallel *parallel, struct scatter_plan *ret_plan)
{
    struct planning planning = {.parallel = parallel, .enough = enough, .node_count = 1};
    const struct sample_range all = {sample, spare, 0, count};
    plan_range(&planning, all);
    if (planning.full) {
        planning.node_count = 1;
        plan_in_order(&planning, all);
    }
    place(planning.nodes, ret_plan);
}
