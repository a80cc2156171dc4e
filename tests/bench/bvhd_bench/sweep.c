/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/sweep.h"

#include <stdlib.h>
#include <string.h>

/* order[axis][begin .. end) holds the same refs for every axis, sorted by their centres. */
struct sweep {
    const struct primitive_ref *refs;
    uint32_t *order[3];
    uint32_t *scratch;
    double *right_area; /* area of refs i .. end, while one axis is swept */
    bool *is_left;
    struct tree tree;
};

struct cut {
    double cost;
    int axis;
    uint32_t at; /* first ref of the right side */
};

struct entry {
    double key;
    uint32_t ref;
};

static int by_key(const void *a, const void *b)
{
    const struct entry *x = a, *y = b;
    return x->key != y->key ? (x->key > y->key ? 1 : -1) : (x->ref > y->ref) - (x->ref < y->ref);
}

static void sort_axis(struct sweep *sweep, int axis, uint32_t count)
{
    struct entry *entries = tree_need(count, sizeof *entries);
    for (uint32_t i = 0; i < count; i++)
        entries[i] = (struct entry){(double)sweep->refs[i].min[axis] + sweep->refs[i].max[axis], i};
    qsort(entries, count, sizeof *entries, by_key);
    for (uint32_t i = 0; i < count; i++)
        sweep->order[axis][i] = entries[i].ref;
    free(entries);
}

static void sweep_axis(struct sweep *sweep, int axis, uint32_t begin, uint32_t end, struct cut *cut)
{
    const uint32_t *order = sweep->order[axis];
    struct box box = box_empty();
    for (uint32_t i = end; i-- > begin + 1;) {
        struct box own = primitive_ref_box(&sweep->refs[order[i]]);
        box_grow(&box, &own);
        sweep->right_area[i] = box_half_area(&box);
    }
    box = box_empty();
    for (uint32_t i = begin + 1; i < end; i++) {
        struct box own = primitive_ref_box(&sweep->refs[order[i - 1]]);
        box_grow(&box, &own);
        double cost = box_half_area(&box) * (i - begin) + sweep->right_area[i] * (end - i);
        if (cost < cut->cost)
            *cut = (struct cut){cost, axis, i};
    }
}

/* Partitions the refs of every axis; within both sides they keep their order. */
static void partition(struct sweep *sweep, const struct cut *cut, uint32_t begin, uint32_t end)
{
    for (uint32_t i = begin; i < end; i++)
        sweep->is_left[sweep->order[cut->axis][i]] = i < cut->at;
    for (int axis = 0; axis < 3; axis++) {
        uint32_t left = begin, right = 0, *order = sweep->order[axis];
        for (uint32_t i = begin; i < end; i++)
            if (sweep->is_left[order[i]])
                order[left++] = order[i];
            else
                sweep->scratch[right++] = order[i];
        memcpy(order + left, sweep->scratch, right * sizeof *order);
    }
}

static void build_node(struct sweep *sweep, uint32_t index, uint32_t begin, uint32_t end)
{
    struct tree_node *node = &sweep->tree.nodes[index];
    node->box = box_empty();
    for (uint32_t i = begin; i < end; i++) {
        struct box own = primitive_ref_box(&sweep->refs[sweep->order[0][i]]);
        box_grow(&node->box, &own);
    }
    double area = box_half_area(&node->box);
    struct cut cut = {area * (end - begin) - area, 0, 0};
    for (int axis = 0; axis < 3 && end - begin > 1; axis++)
        sweep_axis(sweep, axis, begin, end, &cut);
    if (cut.at == 0) {
        node->first = begin;
        node->refs = end - begin;
        return;
    }
    partition(sweep, &cut, begin, end);
    node->first = sweep->tree.node_count;
    node->children = 2;
    sweep->tree.node_count += 2;
    build_node(sweep, sweep->tree.nodes[index].first, begin, cut.at);
    build_node(sweep, sweep->tree.nodes[index].first + 1, cut.at, end);
}

struct tree sweep_build(const struct primitive_ref *refs, uint32_t count)
{
    struct sweep sweep = {.refs = refs, .tree = {.ref_count = count}};
    if (count == 0)
        return sweep.tree;
    for (int axis = 0; axis < 3; axis++) {
        sweep.order[axis] = tree_need(count, sizeof *sweep.order[axis]);
        sort_axis(&sweep, axis, count);
    }
    sweep.scratch = tree_need(count, sizeof *sweep.scratch);
    sweep.right_area = tree_need(count, sizeof *sweep.right_area);
    sweep.is_left = tree_need(count, sizeof *sweep.is_left);
    sweep.tree.nodes = tree_need((size_t)2 * count, sizeof *sweep.tree.nodes);
    sweep.tree.refs = tree_need(count, sizeof *sweep.tree.refs);
    sweep.tree.node_count = 1;
    build_node(&sweep, 0, 0, count);
    for (uint32_t i = 0; i < count; i++)
        sweep.tree.refs[i] = refs[sweep.order[0][i]].id;
    for (int axis = 0; axis < 3; axis++)
        free(sweep.order[axis]);
    free(sweep.scratch);
    free(sweep.right_area);
    free(sweep.is_left);
    return sweep.tree;
}
