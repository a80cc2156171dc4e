/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/depth.h"

#include <stddef.h>

#include "proto/base/parallel.h"

/* The state of one node during the pass. */
struct node_state {
    uint32_t level; /* 1 for the root */
    uint32_t leaves;
    uint32_t first_ref;
    bool solved; /* the subtree fits, or every part of it that is too deep will be rebuilt at this node or below it */
    bool rebuild; /* rebuild this node, unless an ancestor is rebuilt */
};

/* A leaf of a subtree that is being rebuilt, kept while its node is overwritten. */
struct leaf {
    struct ir_node node;
    struct box boxes[IR_MAX_KEYS];
};

struct limiter {
    struct ir *ir;
    uint32_t limit;
    const atomic_bool *cancel;
    struct node_state *facts;
    uint32_t *stack; /* nodes still to visit on the way down a subtree */
    /* first children of the rebuilt subtree's inner nodes: the places for its new nodes, sorted ascending */
    uint32_t *pairs;
    uint32_t pair_count, next_pair;
    struct leaf *leaves;
    uint32_t leaf_count;
};

static uint32_t balanced_height(uint32_t leaves)
{
    return leaves < 2 ? leaves : 33 - (uint32_t)__builtin_clz(leaves - 1);
}

/*
 * Every loop whose length depends on the tree checks this at each step. After a cancellation the tree is discarded, so
 * loops may leave their work half done.
 */
static bool is_cancelled(const struct limiter *limiter, uint32_t step)
{
    return step % 4096 == 0 && parallel_cancelled(limiter->cancel);
}

/* Sets the level of each node, and returns the depth of the tree. */
static uint32_t gather_levels(struct limiter *limiter)
{
    const struct ir *ir = limiter->ir;
    struct node_state *facts = limiter->facts;
    uint32_t depth = 1;
    facts[0].level = 1;
    for (uint32_t node = 0; node < ir->node_count && !is_cancelled(limiter, node); node++) {
        if (ir_is_leaf(ir, node))
            continue;
        uint32_t level = facts[node].level + 1;
        facts[ir->nodes[node].first].level = facts[ir->nodes[node].first + 1].level = level;
        depth = level > depth ? level : depth;
    }
    return depth;
}

static void gather_facts(struct limiter *limiter)
{
    const struct ir *ir = limiter->ir;
    struct node_state *facts = limiter->facts;
    for (uint32_t node = ir->node_count; node-- > 0 && !is_cancelled(limiter, node);) {
        struct node_state *own = &facts[node];
        if (ir_is_leaf(ir, node)) {
            *own = (struct node_state){own->level, 1, ir->nodes[node].first, .solved = own->level <= limiter->limit};
            continue;
        }
        const struct node_state *left = &facts[ir->nodes[node].first], *right = left + 1;
        own->leaves = left->leaves + right->leaves;
        own->first_ref = left->first_ref < right->first_ref ? left->first_ref : right->first_ref;
        bool below = left->solved && right->solved;
        own->rebuild = !below && (uint64_t)own->level + balanced_height(own->leaves) - 1 <= limiter->limit;
        own->solved = below || own->rebuild;
    }
}

/* Collects the leaves below `root` in the order of their refs, and the places of all nodes below it. */
static void take_apart(struct limiter *limiter, uint32_t root)
{
    const struct ir *ir = limiter->ir;
    uint32_t waiting = 0;
    limiter->leaf_count = limiter->pair_count = 0;
    limiter->stack[waiting++] = root;
    for (uint32_t step = 1; waiting > 0 && !is_cancelled(limiter, step); step++) {
        uint32_t node = limiter->stack[--waiting], left = ir->nodes[node].first;
        if (ir_is_leaf(ir, node)) {
            struct leaf *leaf = &limiter->leaves[limiter->leaf_count++];
            leaf->node = ir->nodes[node];
            for (uint32_t key = 0; key < ir->key_count; key++)
                leaf->boxes[key] = ir->boxes[key][node];
            continue;
        }
        limiter->pairs[limiter->pair_count++] = left;
        bool left_first = limiter->facts[left].first_ref < limiter->facts[left + 1].first_ref;
        limiter->stack[waiting++] = left_first ? left + 1 : left;
        limiter->stack[waiting++] = left_first ? left : left + 1;
    }
}

static void sift(uint32_t *heap, uint32_t count, uint32_t at)
{
    for (uint32_t child; (child = 2 * at + 1) < count; at = child) {
        child += child + 1 < count && heap[child + 1] > heap[child];
        if (heap[child] <= heap[at])
            return;
        uint32_t swap = heap[at];
        heap[at] = heap[child];
        heap[child] = swap;
    }
}

static void sort_ascending(const struct limiter *limiter, uint32_t *values, uint32_t count)
{
    for (uint32_t at = count / 2; at-- > 0 && !is_cancelled(limiter, at);)
        sift(values, count, at);
    for (uint32_t end = count; end > 1 && !is_cancelled(limiter, end); end--) {
        uint32_t swap = values[0];
        values[0] = values[end - 1];
        values[end - 1] = swap;
        sift(values, end - 1, 0);
    }
}

/*
 * Makes `node` the root of a balanced tree over leaves [first, end). Pairs of places are used in ascending order on the
 * way down, so that children follow their parents. The recursion is as deep as the balanced tree, at most 32.
 */
static void put_together(struct limiter *limiter, uint32_t node, uint32_t first, uint32_t end)
{
    struct ir *ir = limiter->ir;
    if (end - first == 1) {
        ir->nodes[node] = limiter->leaves[first].node;
        for (uint32_t key = 0; key < ir->key_count; key++)
            ir->boxes[key][node] = limiter->leaves[first].boxes[key];
        return;
    }
    if (end - first > 1024 && parallel_cancelled(limiter->cancel))
        return;
    uint32_t pair = limiter->pairs[limiter->next_pair++], middle = first + (end - first) / 2;
    ir->nodes[node] = (struct ir_node){.first = pair};
    put_together(limiter, pair, first, middle);
    put_together(limiter, pair + 1, middle, end);
    for (uint32_t key = 0; key < ir->key_count; key++) {
        ir->boxes[key][node] = ir->boxes[key][pair];
        box_grow(&ir->boxes[key][node], &ir->boxes[key][pair + 1]);
    }
}

static void rebuild(struct limiter *limiter, uint32_t node)
{
    take_apart(limiter, node);
    for (uint32_t i = 0; i < limiter->pair_count; i++)
        limiter->facts[limiter->pairs[i]].rebuild = limiter->facts[limiter->pairs[i] + 1].rebuild = false;
    sort_ascending(limiter, limiter->pairs, limiter->pair_count);
    limiter->next_pair = 0;
    if (!parallel_cancelled(limiter->cancel))
        put_together(limiter, node, 0, limiter->leaf_count);
}

/* Goes from the top down: rebuilding a node clears the marks of all nodes below it. */
static void rebuild_all(struct limiter *limiter)
{
    for (uint32_t node = 0; node < limiter->ir->node_count && !is_cancelled(limiter, node); node++)
        if (limiter->facts[node].rebuild)
            rebuild(limiter, node);
}

static enum bvhd_status allocate(struct limiter *limiter, struct bvhd_error *error)
{
    const struct ir *ir = limiter->ir;
    uint32_t leaves = ir->node_count / 2 + 1;
    limiter->facts = memory_array(ir->memory, ir->node_count, sizeof *limiter->facts);
    limiter->stack = memory_array(ir->memory, leaves, sizeof *limiter->stack);
    limiter->pairs = memory_array(ir->memory, leaves, sizeof *limiter->pairs);
    limiter->leaves = memory_array(ir->memory, leaves, sizeof *limiter->leaves);
    if (!limiter->facts || !limiter->stack || !limiter->pairs || !limiter->leaves)
        return bvhd_error_no_memory(error, "", "no memory to limit a tree's depth");
    return BVHD_OK;
}

static enum bvhd_status limit_depth(struct limiter *limiter, uint32_t *ret_depth, struct bvhd_error *error)
{
    uint32_t depth = gather_levels(limiter);
    if (depth > limiter->limit) {
        gather_facts(limiter);
        if (!parallel_cancelled(limiter->cancel) && !limiter->facts[0].solved)
            return bvhd_error_set(error, BVHD_TOO_LARGE, "", "%u leaves do not fit into %u levels",
                                  limiter->facts[0].leaves, limiter->limit);
        rebuild_all(limiter);
        depth = gather_levels(limiter);
    }
    if (parallel_cancelled(limiter->cancel))
        return bvhd_error_set(error, BVHD_CANCELLED, "", "cancelled");
    *ret_depth = depth;
    return BVHD_OK;
}

enum bvhd_status depth_limit(struct ir *ir, uint32_t limit, const atomic_bool *cancel, uint32_t *ret_depth,
                             struct bvhd_error *error)
{
    if (ir->node_count == 0) {
        *ret_depth = 0;
        return BVHD_OK;
    }
    struct limiter limiter = {.ir = ir, .limit = limit, .cancel = cancel};
    enum bvhd_status status = allocate(&limiter, error);
    if (status == BVHD_OK)
        status = limit_depth(&limiter, ret_depth, error);
    memory_free(ir->memory, limiter.facts);
    memory_free(ir->memory, limiter.stack);
    memory_free(ir->memory, limiter.pairs);
    memory_free(ir->memory, limiter.leaves);
    return status;
}
