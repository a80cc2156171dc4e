/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/ploc.h"

#include <string.h>

#include "builder/piece/binned.h"
#include "builder/piece/nearest.h"
#include "builder/piece/pack.h"
#include "proto/base/parallel.h"

/* Neighbours considered on either side: a wider search costs more build time than it saves the rays. */
enum { RADIUS = 2 };

/* The clusters of a round, in the order of the curve. */
struct cluster_row {
    struct nearest_boxes boxes;
    uint32_t *nodes;
};

/* A pair's first cluster, and its place in the next round. */
struct move {
    uint32_t from, to;
};

struct clustering {
    struct cluster_tree *tree;
    struct cluster_row row, next;
    uint32_t count; /* clusters in the round */
    int32_t *keys;
    struct move *pairs;
    uint8_t *kept; /* for each cluster, 1 if it has a place in the next round, alone or as the first of a pair */
    void *room;
};

static inline void put(const struct cluster_row *row, uint32_t at, uint32_t node, const struct primitive_ref *ref)
{
    for (int axis = 0; axis < 3; axis++) {
        row->boxes.min[axis][at] = ref->min[axis];
        row->boxes.max[axis][at] = ref->max[axis];
    }
    row->nodes[at] = node;
}

/*
 * Lists the pairs that chose each other, and marks the clusters that have a place in the next round. There are no
 * branches, because choices are unpredictable. Returns the number of clusters of the next round.
 */
static uint32_t list_moves(struct clustering *c, uint32_t *ret_pairs)
{
    struct move *moves = c->pairs;
    const int32_t *keys = c->keys;
    uint8_t *kept = c->kept;
    uint32_t pairs = 0, to = 0, count = c->count;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t partner = nearest_partner(i, keys[i]);
        bool mutual = keys[partner] == keys[i], first = i < partner;
        moves[pairs] = (struct move){i, to};
        pairs += mutual & first;
        to += !mutual | first;
        kept[i] = !mutual | first;
    }
    memset(kept + count, 0, PACK_PAD);
    *ret_pairs = pairs;
    return to;
}

static void merge(struct clustering *c)
{
    const struct cluster_row *row = &c->row, *next = &c->next;
    uint32_t pairs, count = list_moves(c, &pairs);
    pack_row(&row->boxes, row->nodes, c->kept, c->count, &next->boxes, next->nodes);
    for (uint32_t i = 0; i < pairs; i++) {
        uint32_t from = c->pairs[i].from, partner = nearest_partner(from, c->keys[from]);
        uint32_t node = cluster_tree_join(c->tree, row->nodes[from], row->nodes[partner]);
        put(next, c->pairs[i].to, node, cluster_tree_node(c->tree, node));
    }
    struct cluster_row swap = c->row;
    c->row = c->next;
    c->next = swap;
    c->count = count;
}

/* Runs rounds until one cluster is left, or until few merge. Returns false when cancelled. */
static bool run_rounds(struct clustering *c)
{
    /* When a round merges less than this share of the clusters, many more rounds would follow. */
    enum { STALLED = 16 };
    const atomic_bool *cancel = c->tree->request->cancel;
    uint32_t before = UINT32_MAX;
    while (c->count > 1 && before - c->count > before / STALLED) {
        if (parallel_cancelled(cancel))
            return false;
        before = c->count;
        nearest_pad(&c->row.boxes, c->count);
        nearest_find(&c->row.boxes, c->count, RADIUS, c->keys);
        merge(c);
    }
    return !parallel_cancelled(cancel);
}

static void place_row(struct cluster_row *row, float *floats, uint32_t *nodes, uint64_t stride)
{
    for (int axis = 0; axis < 3; axis++) {
        row->boxes.min[axis] = floats + (uint64_t)(2 * axis) * stride + NEAREST_PAD;
        row->boxes.max[axis] = floats + (uint64_t)(2 * axis + 1) * stride + NEAREST_PAD;
    }
    row->nodes = nodes;
}

/*
 * Allocates one block for everything, so that a piece costs one allocation: two sequences of clusters, moves, keys and
 * marks.
 */
static enum bvhd_status make_room(struct clustering *c, struct memory *memory)
{
    uint64_t n = c->tree->leaf_count, stride = n + 2 * NEAREST_PAD;
    uint32_t *words =
        memory_array(memory, 12 * stride + 2 * (n + PACK_PAD) + 3 * (n + 8) + n / 4 + 1 + PACK_PAD / 4, sizeof *words);
    if (!words)
        return BVHD_NO_MEMORY;
    c->room = words;
    float *floats = (float *)(void *)words;
    words += 12 * stride;
    place_row(&c->row, floats, words, stride);
    place_row(&c->next, floats + 6 * stride, words + n + PACK_PAD, stride);
    words += 2 * (n + PACK_PAD);
    c->pairs = (struct move *)(void *)words;
    c->keys = (int32_t *)(void *)(words + 2 * (n + 8));
    c->kept = (uint8_t *)(void *)(words + 3 * (n + 8));
    return BVHD_OK;
}

enum bvhd_status ploc_join(struct cluster_tree *tree, struct memory *memory, uint32_t *ret_root)
{
    struct clustering c = {.tree = tree, .count = tree->leaf_count};
    enum bvhd_status status = make_room(&c, memory);
    if (status != BVHD_OK)
        return status;
    for (uint32_t i = 0; i < tree->leaf_count; i++)
        put(&c.row, i, i, &tree->leaves[i]);
    if (!run_rounds(&c))
        status = BVHD_CANCELLED;
    else if (c.count > 1)
        status = binned_join_nodes(tree, c.row.nodes, c.count, memory, ret_root);
    else
        *ret_root = c.row.nodes[0];
    memory_free(memory, c.room);
    return status;
}
