/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/cluster_tree.h"

#include <string.h>

#include "builder/kernel/leaves.h"
#include "builder/piece/morton.h"

/*
 * Allocates one block for the tree. The second half of the facts, which only inner nodes need, holds the lengths of
 * leaves while these are made; before that the whole array holds the keys of the curve.
 */
static enum bvhd_status make_room(struct cluster_tree *tree, struct memory *memory)
{
    uint64_t n = tree->request->count;
    _Static_assert(sizeof(struct morton_key) == sizeof *tree->facts, "keys lie where facts will be");
    tree->facts = memory_array(memory, 2 * n * sizeof *tree->facts + LEAVES_REFS_MAX * (n + 1) * sizeof *tree->ids, 1);
    if (!tree->facts)
        return BVHD_NO_MEMORY;
    tree->ids = (uint32_t *)(void *)(tree->facts + 2 * n);
    return BVHD_OK;
}

/*
 * Makes leaf `index` of `count` refs of the curve, from `first` on; `index` <= `first`. Its primitives are listed at
 * `ids`. Returns how many there are.
 */
static inline uint32_t make_leaf(struct cluster_tree *tree, uint32_t index, uint32_t first, uint32_t count,
                                 uint32_t ids)
{
    struct primitive_ref *leaf = &tree->leaves[index];
    const struct primitive_ref *refs = &tree->leaves[first];
    const struct vec4_box box = leaves_box(refs, count);
    uint32_t primitives = 0;
    for (uint32_t i = 0; i < count; i++) {
        /* a constant number of stores; there is room for more than are kept */
        for (uint32_t k = 0; k < LEAVES_REFS_MAX; k++)
            tree->ids[ids + primitives + k] = refs[i].id + k;
        primitives += refs[i].link + 1;
    }
    vec4_box_store(leaf, box);
    leaf->id = ids;
    leaf->link = primitives;
    tree->facts[index] = (struct cluster_facts){vec4_box_half_area(box) * (float)primitives, primitives & INT32_MAX, 1};
    return primitives;
}

static enum bvhd_status init(struct cluster_tree *tree, const struct cluster_request *request, struct memory *memory)
{
    *tree = (struct cluster_tree){.request = request, .leaves = request->scratch, .inner = request->refs};
    enum bvhd_status status = make_room(tree, memory);
    if (status != BVHD_OK)
        return status;
    const struct leaves_options options = {request->leaf_max, request->cut_cost};
    const uint32_t count = request->count;
    uint8_t *lengths = (uint8_t *)(void *)(tree->facts + count);
    morton_sort(request->refs, count, (struct morton_key *)(void *)tree->facts, tree->leaves);
    tree->leaf_count = leaves_cut(tree->leaves, count, &options, lengths);
    for (uint32_t i = 0, first = 0, ids = 0; i < tree->leaf_count; first += lengths[i++])
        ids += make_leaf(tree, i, first, lengths[i], ids);
    tree->node_count = tree->leaf_count;
    return BVHD_OK;
}

/*
 * Copies up to three ids without a branch on their number, which is unpredictable: with fewer, one of them is copied
 * again.
 */
static inline void copy_ids(const uint32_t *ids, uint32_t count, uint32_t *ret_ids)
{
    uint32_t second = count > 1, third = count > 2 ? 2 : 0;
    ret_ids[0] = ids[0];
    ret_ids[second] = ids[second];
    ret_ids[third] = ids[third];
    for (uint32_t i = 3; i < count; i++)
        ret_ids[i] = ids[i];
}

/* Copies the ids of all primitives below a node that becomes a leaf, and returns how many there are. */
static uint32_t copy_subtree(const struct cluster_tree *tree, uint32_t node, uint32_t *ret_ids)
{
    uint32_t waiting[32], count = 1, sum = 0;
    waiting[0] = node;
    while (count > 0) {
        uint32_t next = waiting[--count] & ~CLUSTER_BECOMES_LEAF;
        const struct primitive_ref *at = cluster_tree_node(tree, next);
        if (next < tree->leaf_count) {
            copy_ids(tree->ids + at->id, at->link, ret_ids + sum);
            sum += at->link;
        } else {
            waiting[count++] = at->id;
            waiting[count++] = at->link;
        }
    }
    return sum;
}

/* A node whose children become the next pair of the ir. */
struct written {
    uint32_t child; /* the node's number as its parent has it */
    uint32_t ir_node, level;
};

struct writer {
    const struct cluster_tree *tree;
    struct ir *ir;
    struct written waiting[36];
    uint32_t waiting_count, depth;
    double cost;
};

/*
 * Writes one node. Whether it becomes a leaf is unpredictable, so it is always stored as waiting, and counted only if
 * it is no leaf.
 */
static inline void write_node(struct writer *w, uint32_t child, uint32_t ir_node, uint32_t level)
{
    const struct cluster_tree *tree = w->tree;
    struct ir *ir = w->ir;
    const bool leaf = child >= CLUSTER_BECOMES_LEAF;
    const uint32_t node = child & ~CLUSTER_BECOMES_LEAF, first = ir->ref_count;
    const struct primitive_ref *ref = cluster_tree_node(tree, node);
    const struct vec4_box box = vec4_box_load(ref);
    uint32_t refs = 0;
    if (node >= tree->leaf_count)
        refs = leaf ? copy_subtree(tree, node, ir->refs + first) : 0;
    else
        copy_ids(tree->ids + ref->id, refs = ref->link, ir->refs + first);
    vec4_box_put(box, &ir->boxes[0][ir_node]);
    ir->nodes[ir_node] = (struct ir_node){first, refs};
    ir->ref_count = first + refs;
    w->cost += vec4_box_half_area_double(box) * (leaf ? refs : 1);
    w->depth = level > w->depth ? level : w->depth;
    w->waiting[w->waiting_count] = (struct written){child, ir_node, level};
    w->waiting_count += !leaf;
}

/*
 * Writes everything below the waiting nodes. The larger child waits while the smaller one is written, so at most 32
 * wait.
 */
static void write_below(struct writer *w)
{
    while (w->waiting_count > 0) {
        const struct written at = w->waiting[--w->waiting_count];
        const struct primitive_ref *ref = cluster_tree_node(w->tree, at.child);
        uint32_t pair = w->ir->node_count;
        w->ir->node_count += 2;
        w->ir->nodes[at.ir_node].first = pair;
        write_node(w, ref->link, pair, at.level + 1);
        write_node(w, ref->id, pair + 1, at.level + 1);
    }
}

static enum bvhd_status write(const struct cluster_tree *tree, uint32_t root, struct memory *memory, struct ir *ret_ir,
                              uint32_t *ret_depth, double *ret_cost)
{
    struct ir ir;
    enum bvhd_status status = ir_init(&ir, memory, 2 * tree->leaf_count - 1, tree->facts[root].refs, NULL);
    if (status != BVHD_OK)
        return status;
    struct writer w = {.tree = tree, .ir = &ir};
    ir.node_count = 1;
    ir.ref_count = 0;
    write_node(&w, cluster_as_child(tree, root), 0, 1);
    write_below(&w);
    *ret_ir = ir;
    *ret_depth = w.depth;
    *ret_cost = w.cost;
    return BVHD_OK;
}

enum bvhd_status cluster_tree_build(const struct cluster_request *request, cluster_joiner *join, struct memory *memory,
                                    struct ir *ret_ir, uint32_t *ret_depth, double *ret_cost, struct bvhd_error *error)
{
    struct cluster_tree tree;
    uint32_t root;
    enum bvhd_status status = init(&tree, request, memory);
    if (status == BVHD_OK)
        status = join(&tree, memory, &root);
    if (status == BVHD_OK)
        status = write(&tree, root, memory, ret_ir, ret_depth, ret_cost);
    memory_free(memory, tree.facts);
    if (status == BVHD_OK)
        return BVHD_OK;
    return bvhd_error_set(error, status, "",
                          status == BVHD_CANCELLED ? "cancelled" : "no memory for a tree of %u primitives",
                          request->count);
}
