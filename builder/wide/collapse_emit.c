/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/wide/collapse_emit.h"

#include <assert.h>

#include "builder/wide/octants.h"

/*
 * Subtrees with this many refs are laid out as separate tasks: few enough refs to share the work evenly, and enough to
 * be worth a copy.
 */
enum { TASK_MAX = 4096, TASK_MIN = 256 };

/* Nodes between two checks of the cancel flag. */
enum { STRIDE = 4096 };

#define NO_NODE UINT32_C(0xffffffff)

/*
 * A growing array of wide nodes whose slots are filled. While a node waits for its visit, its first_child links the
 * stack of waiting nodes and its first_leaf is its level; afterwards first_leaf is the number of its leaf refs, until
 * place_leaves turns those into positions.
 */
struct node_buffer {
    struct wide_node *nodes;
    uint32_t count, capacity;
    uint32_t depth;
    uint32_t waiting; /* top of the stack, or NO_NODE */
};

struct task {
    uint32_t skeleton; /* index of its root in the skeleton */
    uint32_t node; /* its root in the ir */
    uint32_t base; /* where its nodes below the root go */
    struct node_buffer run;
};

struct emission {
    const struct collapse_table *table;
    const atomic_bool *cancel;
    struct memory *memory;
    bool avx2;
    bool shared_out; /* divided into tasks among threads; a single thread needs no tasks, and saves the copies */
    struct task *tasks;
    uint32_t task_count, task_capacity;
    struct wide_node *placed;
    _Atomic int status;
};

static bool fail(struct emission *emission, enum bvhd_status status)
{
    int none = BVHD_OK;
    atomic_compare_exchange_strong(&emission->status, &none, (int)status);
    return false;
}

static bool reserve(struct emission *emission, struct node_buffer *run, uint32_t count)
{
    uint64_t needed = (uint64_t)run->count + count;
    if (needed <= run->capacity)
        return true;
    uint64_t capacity = needed + run->capacity / 2;
    struct wide_node *nodes =
        capacity <= NO_NODE / 2 ? memory_resize(emission->memory, run->nodes, capacity * sizeof *nodes) : NULL;
    if (!nodes)
        return fail(emission, BVHD_NO_MEMORY);
    run->nodes = nodes;
    run->capacity = (uint32_t)capacity;
    return true;
}

/* Fills the slots of a node. */
static void fill_slots(const struct emission *emission, struct wide_node *wide)
{
    const struct ir *ir = emission->table->ir;
    struct wide_child children[WIDE_ARITY] = {{0}};
    const struct box *boxes[WIDE_ARITY];
    uint8_t order[WIDE_ARITY];
    unsigned count = collapse_children(emission->table, wide->node, children);
    for (unsigned i = 0; i < WIDE_ARITY; i++)
        boxes[i] = &ir->boxes[0][children[i].node];
    octants_assign_boxes(&ir->boxes[0][wide->node], boxes, count, emission->table->order_rounds, emission->avx2, order);
    for (unsigned slot = 0; slot < WIDE_ARITY; slot++)
        wide->slots[slot] = children[order[slot]];
}

/* Starts a run with one node, which waits for its visit, and reserves room for a subtree of `refs` refs. */
static bool start(struct emission *emission, struct node_buffer *run, uint32_t node, uint32_t refs)
{
    *run = (struct node_buffer){.waiting = NO_NODE};
    if (!reserve(emission, run, refs / 8 + 8))
        return false;
    run->nodes[0] = (struct wide_node){.node = node, .first_child = NO_NODE, .first_leaf = 1};
    fill_slots(emission, &run->nodes[0]);
    run->count = 1;
    run->waiting = 0;
    return true;
}

/*
 * Visits the waiting node on top; its inner children then wait, in slot order. Every slot is written to the next place
 * and kept if it is an inner child, without a branch, because that is unpredictable. The slots of all children are
 * filled here, before any of them decides where to go on, so that the processor works on several at once.
 */
static bool visit(struct emission *emission, struct node_buffer *run)
{
    if (!reserve(emission, run, WIDE_ARITY))
        return false;
    struct wide_node *node = &run->nodes[run->waiting];
    uint32_t level = node->first_leaf, below = node->first_child, first = run->count, next = first, leaf_refs = 0;
    run->depth = level > run->depth ? level : run->depth;
    for (unsigned slot = 0; slot < WIDE_ARITY; slot++) {
        const struct wide_child *child = &node->slots[slot];
        struct wide_node *place = &run->nodes[next];
        place->node = child->node;
        place->first_child = next + 1;
        place->first_leaf = level + 1;
        next += (child->ref_count == 0) & (child->node != WIDE_NONE);
        leaf_refs += child->ref_count;
    }
    bool any = next > first;
    if (any)
        run->nodes[next - 1].first_child = below;
    for (uint32_t i = first; i < next; i++)
        fill_slots(emission, &run->nodes[i]);
    node->first_leaf = leaf_refs;
    node->first_child = any ? first : 0;
    run->waiting = any ? first : below;
    run->count = next;
    return true;
}

static bool add_task(struct emission *emission, uint32_t skeleton, uint32_t node)
{
    if (emission->task_count == emission->task_capacity) {
        uint32_t capacity = emission->task_capacity * 2 + 64;
        struct task *tasks = memory_resize(emission->memory, emission->tasks, capacity * sizeof *tasks);
        if (!tasks)
            return fail(emission, BVHD_NO_MEMORY);
        emission->tasks = tasks;
        emission->task_capacity = capacity;
    }
    emission->tasks[emission->task_count++] = (struct task){.skeleton = skeleton, .node = node};
    return true;
}

/*
 * Lays out the top of the tree (the skeleton). Subtrees of middle size become tasks; their roots stay in the waiting
 * state, with their level in first_leaf.
 */
static bool emit_skeleton(struct emission *emission, struct node_buffer *run)
{
    if (!start(emission, run, 0, emission->shared_out ? 0 : collapse_count(emission->table, 0)))
        return false;
    for (uint32_t step = 1; run->waiting != NO_NODE; step++) {
        uint32_t node = run->nodes[run->waiting].node;
        if (step % STRIDE == 0 && parallel_cancelled(emission->cancel))
            return fail(emission, BVHD_CANCELLED);
        uint32_t refs = collapse_count(emission->table, node);
        if (refs > TASK_MAX || refs < TASK_MIN || !emission->shared_out) {
            if (!visit(emission, run))
                return false;
        } else {
            if (!add_task(emission, run->waiting, node))
                return false;
            run->waiting = run->nodes[run->waiting].first_child;
        }
    }
    return true;
}

static void emit_task(void *context, size_t index)
{
    struct emission *emission = context;
    struct task *task = &emission->tasks[index];
    if (parallel_cancelled(emission->cancel))
        fail(emission, BVHD_CANCELLED);
    if (atomic_load_explicit(&emission->status, memory_order_relaxed) != BVHD_OK)
        return;
    if (!start(emission, &task->run, task->node, collapse_count(emission->table, task->node)))
        return;
    while (task->run.waiting != NO_NODE)
        if (!visit(emission, &task->run))
            return;
}

static void copy_task(void *context, size_t index)
{
    struct emission *emission = context;
    const struct task *task = &emission->tasks[index];
    const struct node_buffer *run = &task->run;
    for (uint32_t i = 1; i < run->count; i++) {
        struct wide_node *placed = &emission->placed[task->base + i - 1];
        *placed = run->nodes[i];
        if (placed->first_child)
            placed->first_child += task->base - 1;
    }
}

/*
 * Places every node of the skeleton, again depth first, with gaps for the nodes of tasks. The skeleton was laid out in
 * the order of visits, so this second walk meets the tasks in their order.
 */
static uint32_t place_skeleton(struct emission *emission, struct node_buffer *skeleton)
{
    struct wide_node *placed = emission->placed;
    struct task *task = emission->tasks, *end = emission->task_count ? task + emission->task_count : task;
    uint32_t next = 1, waiting = 0;
    placed[0] = skeleton->nodes[0];
    /*
     * A placed node that waits has its index in the skeleton in first_leaf, and the link of the stack in slots[0].node.
     */
    placed[0].first_leaf = 0;
    placed[0].slots[0].node = NO_NODE;
    for (uint32_t step = 1; waiting != NO_NODE; step++) {
        if (step % STRIDE == 0 && parallel_cancelled(emission->cancel))
            return next;
        struct wide_node *place = &placed[waiting];
        uint32_t source = place->first_leaf, here = waiting;
        waiting = place->slots[0].node;
        if (task < end && task->skeleton == source) {
            *place = task->run.nodes[0];
            if (place->first_child)
                place->first_child += next - 1;
            task->base = next;
            next += task->run.count - 1;
            task++;
            continue;
        }
        *place = skeleton->nodes[source];
        unsigned inner = 0;
        for (int slot = 0; slot < WIDE_ARITY; slot++)
            inner += wide_kind(&place->slots[slot]) == WIDE_INNER;
        if (inner == 0)
            continue;
        uint32_t from = placed[here].first_child;
        placed[here].first_child = next;
        for (unsigned i = inner; i-- > 0;) {
            placed[next + i].first_leaf = from + i;
            placed[next + i].slots[0].node = waiting;
            waiting = next + i;
        }
        next += inner;
    }
    return next;
}

/* Without tasks the skeleton already is the tree, in its order. */
static uint32_t take_skeleton(struct emission *emission, struct node_buffer *skeleton)
{
    emission->placed = skeleton->nodes;
    skeleton->nodes = NULL;
    return skeleton->count;
}

/* Turns the numbers of leaf refs in first_leaf into their running sums, and returns the total. */
static uint32_t place_leaves(const struct emission *emission, uint32_t count)
{
    struct wide_node *nodes = emission->placed;
    uint32_t sum = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (i % STRIDE == 0 && parallel_cancelled(emission->cancel))
            return sum;
        uint32_t refs = nodes[i].first_leaf;
        nodes[i].first_leaf = sum;
        sum += refs;
    }
    return sum;
}

static uint32_t total_depth(const struct emission *emission, const struct node_buffer *skeleton)
{
    uint32_t depth = skeleton->depth;
    for (uint32_t i = 0; i < emission->task_count; i++) {
        const struct task *task = &emission->tasks[i];
        uint32_t below = skeleton->nodes[task->skeleton].first_leaf - 1 + task->run.depth;
        depth = below > depth ? below : depth;
    }
    return depth;
}

static enum bvhd_status join(struct emission *emission, struct node_buffer *skeleton, const struct parallel *parallel,
                             struct wide *ret_wide)
{
    uint64_t count = skeleton->count;
    for (uint32_t i = 0; i < emission->task_count; i++)
        count += emission->tasks[i].run.count - 1;
    if (emission->task_count > 0)
        emission->placed = count < NO_NODE ? memory_array(emission->memory, count, sizeof *emission->placed) : NULL;
    if (emission->task_count > 0 && !emission->placed)
        return BVHD_NO_MEMORY;
    uint32_t placed = emission->task_count > 0 ? place_skeleton(emission, skeleton) : take_skeleton(emission, skeleton);
    assert(placed == count || parallel_cancelled(emission->cancel));
    bool done = parallel_for_until(parallel, emission->cancel, emission->task_count, copy_task, emission);
    uint32_t leaf_refs = done ? place_leaves(emission, placed) : 0;
    if (parallel_cancelled(emission->cancel)) {
        memory_free(emission->memory, emission->placed);
        return BVHD_CANCELLED;
    }
    *ret_wide = (struct wide){
        .node_count = placed,
        .leaf_refs = leaf_refs,
        .depth = total_depth(emission, skeleton),
        .nodes = emission->placed,
        .memory = emission->memory,
    };
    return BVHD_OK;
}

enum bvhd_status collapse_emit(const struct collapse_table *table, const atomic_bool *cancel, struct memory *memory,
                               const struct parallel *parallel, struct wide *ret_wide)
{
    struct emission emission = {.table = table,
                                .cancel = cancel,
                                .memory = memory,
                                .avx2 = octants_has_avx2(),
                                .shared_out = parallel->threads > 1,
                                .status = BVHD_OK};
    struct node_buffer skeleton;
    if (emit_skeleton(&emission, &skeleton))
        parallel_for(parallel, emission.task_count, emit_task, &emission);
    enum bvhd_status status = (enum bvhd_status)atomic_load(&emission.status);
    if (status == BVHD_OK)
        status = join(&emission, &skeleton, parallel, ret_wide);
    for (uint32_t i = 0; i < emission.task_count; i++)
        memory_free(memory, emission.tasks[i].run.nodes);
    memory_free(memory, emission.tasks);
    memory_free(memory, skeleton.nodes);
    return status;
}
