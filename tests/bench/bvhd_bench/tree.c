/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/tree.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/bench/bvhd_bench/surface.h"

void *tree_need(size_t count, size_t size)
{
    void *block = calloc(count ? count : 1, size);
    if (!block) {
        fprintf(stderr, "bvhd-bench: no memory\n");
        exit(1);
    }
    return block;
}

struct tree tree_from_ir(const struct ir *ir)
{
    struct tree tree = {.node_count = ir->node_count, .ref_count = ir->ref_count};
    tree.nodes = tree_need(ir->node_count, sizeof *tree.nodes);
    tree.refs = tree_need(ir->ref_count, sizeof *tree.refs);
    for (uint32_t i = 0; i < ir->node_count; i++) {
        bool is_leaf = ir_is_leaf(ir, i);
        tree.nodes[i] = (struct tree_node){ir->boxes[0][i], ir->nodes[i].first, is_leaf ? 0 : 2, ir->nodes[i].count};
    }
    if (ir->ref_count)
        memcpy(tree.refs, ir->refs, ir->ref_count * sizeof *tree.refs);
    return tree;
}

void tree_finish(struct tree *tree)
{
    if (!tree)
        return;
    free(tree->nodes);
    free(tree->refs);
    *tree = (struct tree){0};
}

uint32_t tree_depth(const struct tree *tree)
{
    uint32_t *levels = tree_need(tree->node_count, sizeof *levels), depth = 0;
    for (uint32_t i = 0; i < tree->node_count; i++) {
        levels[i] += 1;
        depth = levels[i] > depth ? levels[i] : depth;
        for (uint32_t k = 0; k < tree->nodes[i].children; k++)
            levels[tree->nodes[i].first + k] = levels[i];
    }
    free(levels);
    return depth;
}

double tree_sah(const struct tree *tree)
{
    double sum = 0, root = tree->node_count ? box_half_area(&tree->nodes[0].box) : 0;
    for (uint32_t i = 0; i < tree->node_count; i++) {
        const struct tree_node *node = &tree->nodes[i];
        sum += box_half_area(&node->box) * (node->children ? 1 : node->refs);
    }
    return root > 0 ? sum / root : 0;
}

static bool holds(const struct box *box, const double point[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (!(point[axis] >= box->min[axis] && point[axis] <= box->max[axis]))
            return false;
    return true;
}

/*
 * The cost of the nodes at and below `index` whose box contains the sample, but whose subtree does not contain its
 * triangle.
 */
static double overlap_below(const struct tree *tree, uint32_t index, const struct surface_point *sample,
                            bool *ret_belongs)
{
    const struct tree_node *node = &tree->nodes[index];
    double cost = 0;
    bool belongs = false;
    if (!holds(&node->box, sample->position))
        return 0;
    for (uint32_t k = 0; k < node->children; k++)
        cost += overlap_below(tree, node->first + k, sample, &belongs);
    for (uint32_t k = 0; k < node->refs; k++)
        belongs |= tree->refs[node->first + k] == sample->triangle;
    *ret_belongs |= belongs;
    return belongs ? cost : cost + (node->children ? 1 : node->refs);
}

double tree_overlap(const struct tree *tree, const struct ply *mesh, uint32_t samples)
{
    struct surface surface = surface_of(mesh);
    struct random random = {5};
    double cost = 0;
    if (tree->node_count && surface.count)
        for (uint32_t i = 0; i < samples; i++) {
            struct surface_point sample = surface_draw(&surface, &random);
            bool belongs = false;
            cost += overlap_below(tree, 0, &sample, &belongs);
        }
    surface_finish(&surface);
    return cost / samples;
}
