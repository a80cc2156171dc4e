/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/reinsertion.h"

#include <string.h>

#include "proto/base/parallel.h"
#include "builder/kernel/vec4.h"

#define IS_LEAF UINT32_C(0x80000000)

struct node {
    float min[3];
    uint32_t first; /* the first of both children; for a leaf its primitive, with IS_LEAF */
    float max[3];
    uint32_t parent;
};

/* How a subtree will be written. */
struct subtree_plan {
    float cost; /* SAH cost, not divided by the root's area */
    uint32_t refs; /* refs in it; while they are at most leaf_max, each primitive counts once */
    uint32_t ids[REINSERTION_LEAF_MOST]; /* the primitives, while they are at most leaf_max */
    bool leaf;
};

struct tree {
    const struct reinsertion_request *request;
    struct node *nodes;
    struct subtree_plan *facts;
    uint32_t *order; /* all nodes, parents before children */
    uint32_t count;
    uint64_t steps; /* nodes visited so far */
};

/* A place for a subtree: the node beside which it would go, and by how much that lowers the sum of areas. */
struct insertion_point {
    uint32_t node;
    float gain;
};

/*
 * A subtree to search. Putting a node anywhere into it lowers the sum of areas by at most `saved` minus the node's own
 * area.
 */
struct search_candidate {
    float saved;
    uint32_t node;
};

/*
 * Limits of the search: subtrees that wait, and nodes visited, in one search, after which the best place found so far
 * is used; nodes visited in all searches, for each node of the tree.
 */
enum { WAITING_MOST = 128, SEARCH_MOST = 1024, STEPS_A_NODE = 256 };

/* Pairs of children start at odd numbers. */
static inline uint32_t sibling_of(uint32_t node)
{
    return ((node - 1) ^ 1) + 1;
}

static inline struct vec4_box box_at(const struct tree *tree, uint32_t node)
{
    return vec4_box_load(&tree->nodes[node]);
}

static inline struct vec4_box unite(struct vec4_box a, struct vec4_box b)
{
    return (struct vec4_box){vec4_min(a.min, b.min), vec4_max(a.max, b.max)};
}

/* Sets the box, and keeps the other fields, which share its lanes. */
static inline void set_box(struct node *node, struct vec4_box box)
{
    uint32_t first = node->first, parent = node->parent;
    vec4_box_store(node, box);
    node->first = first;
    node->parent = parent;
}

static inline bool same(struct vec4_box a, struct vec4_box b)
{
    return (vec4_bits(a.min == b.min) & vec4_bits(a.max == b.max) & 7) == 7;
}

/*
 * Searches a subtree for a better place: boxes on the way down would grow by `box`, and a subtree that cannot hold a
 * better place is not entered. Returns the number of nodes visited.
 */
static uint32_t search_below(const struct tree *tree, struct vec4_box box, float area, struct search_candidate at,
                             struct insertion_point *best)
{
    struct search_candidate stack[WAITING_MOST];
    uint32_t height = 0, steps = 0;
    for (;;) {
        if (at.saved - area > best->gain) {
            struct vec4_box there = box_at(tree, at.node);
            float gain = at.saved - vec4_box_half_area(unite(box, there)), below = gain + vec4_box_half_area(there);
            uint32_t first = tree->nodes[at.node].first;
            if (gain > best->gain)
                *best = (struct insertion_point){at.node, gain};
            steps++;
            if (!(first & IS_LEAF) && height < WAITING_MOST) {
                stack[height++] = (struct search_candidate){below, first};
                at = (struct search_candidate){below, first + 1};
                continue;
            }
        }
        if (height == 0 || steps > SEARCH_MOST)
            return steps;
        at = stack[--height];
    }
}

/* Goes up from the node, and searches the other side of each ancestor, and the place beside the ancestor itself. */
static struct insertion_point find_place(struct tree *tree, uint32_t node)
{
    const struct node *nodes = tree->nodes;
    const struct vec4_box box = box_at(tree, node);
    const uint32_t parent = nodes[node].parent;
    uint32_t ancestor = parent, side = sibling_of(node), steps = 0;
    struct vec4_box rest = box_at(tree, side); /* the ancestor's box without the node */
    float area = vec4_box_half_area(box), saved = vec4_box_half_area(box_at(tree, parent));
    struct insertion_point best = {0, 0};
    for (;;) {
        steps += search_below(tree, box, area, (struct search_candidate){saved, side}, &best) + 1;
        if (ancestor != parent) {
            float whole = vec4_box_half_area(box_at(tree, ancestor));
            rest = unite(rest, box_at(tree, side));
            saved += whole - vec4_box_half_area(rest);
            if (saved - whole > best.gain)
                best = (struct insertion_point){ancestor, saved - whole};
        }
        if (ancestor == 0 || steps > SEARCH_MOST)
            break;
        side = sibling_of(ancestor);
        ancestor = nodes[ancestor].parent;
    }
    tree->steps += steps;
    return best;
}

static inline void put(struct node *nodes, struct node content, uint32_t at, uint32_t parent)
{
    content.parent = parent;
    nodes[at] = content;
    if (!(content.first & IS_LEAF))
        nodes[content.first].parent = nodes[content.first + 1].parent = at;
}

static void shrink_ancestors(struct tree *tree, uint32_t node)
{
    while (node != 0) {
        node = tree->nodes[node].parent;
        uint32_t first = tree->nodes[node].first;
        struct vec4_box box = unite(box_at(tree, first), box_at(tree, first + 1));
        tree->steps++;
        if (same(box, box_at(tree, node)))
            return;
        set_box(&tree->nodes[node], box);
    }
}

static void grow_ancestors(struct tree *tree, uint32_t node, struct vec4_box by)
{
    while (node != 0) {
        node = tree->nodes[node].parent;
        struct vec4_box box = box_at(tree, node), grown = unite(box, by);
        tree->steps++;
        if (same(box, grown))
            return;
        set_box(&tree->nodes[node], grown);
    }
}

/*
 * Moves a node beside `target`: its sibling takes their parent's place, and the pair of places that this frees goes to
 * the target and the node.
 */
static void reinsert(struct tree *tree, uint32_t node, uint32_t target)
{
    struct node *nodes = tree->nodes;
    const struct node moved = nodes[node];
    const struct vec4_box box = box_at(tree, node);
    uint32_t parent = moved.parent, pair = nodes[parent].first;
    put(nodes, nodes[sibling_of(node)], parent, nodes[parent].parent);
    shrink_ancestors(tree, parent);
    put(nodes, nodes[target], pair, target);
    put(nodes, moved, pair + 1, target);
    set_box(&nodes[target], unite(box_at(tree, pair), box));
    nodes[target].first = pair;
    grow_ancestors(tree, target, box);
}

/*
 * Returns the upper bits of a float that is not negative: sixteen ranks for each power of two, in the order of the
 * values.
 */
static inline uint32_t rank_of(float area)
{
    uint32_t bits;
    memcpy(&bits, &area, sizeof bits);
    return bits >> 19;
}

enum { RANKS = 1 << 12 };

/* Returns the lowest rank such that the nodes of this rank and above are no more than a pass tries. */
static uint32_t lowest_rank(const struct tree *tree, float share)
{
    uint64_t most = (uint64_t)((double)share * tree->count), sum = 0;
    uint32_t histogram[RANKS] = {0}, rank = RANKS;
    for (uint32_t i = 1; i < tree->count; i++)
        histogram[rank_of(vec4_box_half_area(box_at(tree, i))) % RANKS]++;
    while (rank > 0 && sum + histogram[rank - 1] <= most)
        sum += histogram[--rank];
    return rank;
}

static bool improve(struct tree *tree)
{
    enum { LOOK_EVERY = 256 };
    const struct reinsertion_request *request = tree->request;
    const uint64_t most = (uint64_t)tree->count * STEPS_A_NODE;
    for (uint32_t pass = 0; pass < request->passes; pass++) {
        uint32_t lowest = lowest_rank(tree, pass + 1 < request->passes ? request->share : request->last_share);
        for (uint32_t i = 1; i < tree->count && tree->steps < most; i++) {
            if (i % LOOK_EVERY == 0 && parallel_cancelled(request->cancel))
                return false;
            /* A child of the root could only go back to the same place. */
            if (tree->nodes[i].parent == 0 || rank_of(vec4_box_half_area(box_at(tree, i))) < lowest)
                continue;
            struct insertion_point place = find_place(tree, i);
            if (place.gain > 0)
                reinsert(tree, i, place.node);
        }
    }
    return !parallel_cancelled(request->cancel);
}

static void load(struct tree *tree)
{
    const struct ir *ir = tree->request->ir;
    tree->nodes[0].parent = 0;
    for (uint32_t i = 0; i < tree->count; i++) {
        struct node *node = &tree->nodes[i];
        const struct ir_node from = ir->nodes[i];
        memcpy(node->min, ir->boxes[0][i].min, sizeof node->min);
        memcpy(node->max, ir->boxes[0][i].max, sizeof node->max);
        node->first = from.count ? ir->refs[from.first] | IS_LEAF : from.first;
        if (!from.count)
            tree->nodes[from.first].parent = tree->nodes[from.first + 1].parent = i;
    }
}

/*
 * Merges the primitives of both children, each once, as long as there is room. Returns how many there are, or room + 1
 * when there are more.
 */
static uint32_t merge_ids(const struct subtree_plan *left, const struct subtree_plan *right, uint32_t room,
                          uint32_t *ret_ids)
{
    uint32_t count = left->refs;
    memcpy(ret_ids, left->ids, sizeof left->ids);
    for (uint32_t i = 0; i < right->refs; i++) {
        uint32_t k = 0;
        while (k < left->refs && left->ids[k] != right->ids[i])
            k++;
        if (k < left->refs)
            continue;
        if (count == room)
            return room + 1;
        ret_ids[count++] = right->ids[i];
    }
    return count;
}

static struct subtree_plan facts_of(const struct tree *tree, uint32_t at)
{
    const struct node *node = &tree->nodes[at];
    const uint32_t leaf_max = tree->request->leaf_max;
    float area = vec4_box_half_area(box_at(tree, at));
    if (node->first & IS_LEAF)
        return (struct subtree_plan){area, 1, {node->first & ~IS_LEAF}, true};
    const struct subtree_plan *left = &tree->facts[node->first], *right = left + 1;
    struct subtree_plan facts = {.cost = area + left->cost + right->cost, .refs = left->refs + right->refs};
    uint32_t ids[REINSERTION_LEAF_MOST];
    if (left->refs > leaf_max || right->refs > leaf_max)
        return facts;
    uint32_t refs = merge_ids(left, right, leaf_max, ids);
    if (refs > leaf_max)
        return facts;
    float as_leaf = area * (float)refs;
    facts.leaf = refs < facts.refs || as_leaf <= facts.cost;
    facts.cost = facts.leaf ? as_leaf : facts.cost;
    facts.refs = refs;
    memcpy(facts.ids, ids, sizeof ids);
    return facts;
}

/* Computes the facts of all nodes, children before their parents. */
static void find_facts(struct tree *tree)
{
    uint32_t count = 0;
    tree->order[count++] = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t first = tree->nodes[tree->order[i]].first;
        if (first & IS_LEAF)
            continue;
        tree->order[count++] = first;
        tree->order[count++] = first + 1;
    }
    while (count-- > 0)
        tree->facts[tree->order[count]] = facts_of(tree, tree->order[count]);
}

struct emitted {
    uint32_t node, ir_node;
};

/* Writes the tree. The child with more refs waits while the other one is written, so at most 32 wait. */
static void emit(const struct tree *tree, struct ir *ir)
{
    struct emitted waiting[33], at = {0, 0};
    uint32_t waiting_count = 0;
    ir->node_count = 1;
    for (;;) {
        const struct subtree_plan *facts = &tree->facts[at.node];
        ir->boxes[0][at.ir_node] = vec4_box_get(box_at(tree, at.node));
        if (facts->leaf) {
            ir->nodes[at.ir_node] = (struct ir_node){ir->ref_count, facts->refs};
            memcpy(ir->refs + ir->ref_count, facts->ids, facts->refs * sizeof *ir->refs);
            ir->ref_count += facts->refs;
            if (waiting_count == 0)
                return;
            at = waiting[--waiting_count];
            continue;
        }
        uint32_t first = tree->nodes[at.node].first, pair = ir->node_count;
        bool right_first = tree->facts[first + 1].refs < tree->facts[first].refs;
        ir->node_count += 2;
        ir->nodes[at.ir_node] = (struct ir_node){.first = pair};
        waiting[waiting_count++] = (struct emitted){first + !right_first, pair + !right_first};
        at = (struct emitted){first + right_first, pair + right_first};
    }
}

/* Each array is freed as soon as it is no longer needed, because several pieces are built at once. */
static enum bvhd_status run(struct tree *tree, struct memory *memory, struct ir *ret_ir)
{
    tree->nodes = memory_array(memory, tree->count, sizeof *tree->nodes);
    if (!tree->nodes)
        return BVHD_NO_MEMORY;
    load(tree);
    ir_finish(tree->request->ir);
    if (!improve(tree))
        return BVHD_CANCELLED;
    tree->facts = memory_array(memory, tree->count, sizeof *tree->facts);
    tree->order = memory_array(memory, tree->count, sizeof *tree->order);
    if (!tree->facts || !tree->order)
        return BVHD_NO_MEMORY;
    find_facts(tree);
    memory_free(memory, tree->order);
    tree->order = NULL;
    enum bvhd_status status = ir_init(ret_ir, memory, tree->count, tree->facts[0].refs, NULL);
    if (status == BVHD_OK)
        emit(tree, ret_ir);
    return status;
}

enum bvhd_status reinsertion_run(const struct reinsertion_request *request, struct memory *memory, struct ir *ret_ir,
                                 struct bvhd_error *error)
{
    struct tree tree = {.request = request, .count = request->ir->node_count};
    struct ir ir;
    enum bvhd_status status = run(&tree, memory, &ir);
    memory_free(memory, tree.nodes);
    memory_free(memory, tree.facts);
    memory_free(memory, tree.order);
    if (status == BVHD_OK) {
        *ret_ir = ir;
        return BVHD_OK;
    }
    return bvhd_error_set(error, status, "", status == BVHD_CANCELLED ? "cancelled" : "no memory to improve a tree");
}
