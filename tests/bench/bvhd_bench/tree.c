/* SPDX-License-Identifier: Apache-2.0 */
#include "tree.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "random.h"

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

/* A point of the surface, and the triangle that it is on. */
struct sample {
    double point[3];
    uint32_t triangle;
};

static bool holds(const struct box *box, const double point[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (!(point[axis] >= box->min[axis] && point[axis] <= box->max[axis]))
            return false;
    return true;
}

/* The cost of the nodes below and at `index` that the sample lies in without belonging there. */
static double overlap_below(const struct tree *tree, uint32_t index, const struct sample *sample, bool *ret_belongs)
{
    const struct tree_node *node = &tree->nodes[index];
    double cost = 0;
    bool belongs = false;
    if (!holds(&node->box, sample->point))
        return 0;
    for (uint32_t k = 0; k < node->children; k++)
        cost += overlap_below(tree, node->first + k, sample, &belongs);
    for (uint32_t k = 0; k < node->refs; k++)
        belongs |= tree->refs[node->first + k] == sample->triangle;
    *ret_belongs |= belongs;
    return belongs ? cost : cost + (node->children ? 1 : node->refs);
}

static double triangle_area(const struct ply *mesh, uint32_t triangle)
{
    double edges[2][3];
    const float *corners[3];
    for (int k = 0; k < 3; k++)
        corners[k] = mesh->positions + (size_t)3 * mesh->indices[(size_t)3 * triangle + (size_t)k];
    for (int k = 0; k < 2; k++)
        for (int axis = 0; axis < 3; axis++)
            edges[k][axis] = (double)corners[k + 1][axis] - corners[0][axis];
    double area =
        hypot(hypot(edges[0][1] * edges[1][2] - edges[0][2] * edges[1][1], edges[0][2] * edges[1][0] - edges[0][0] * edges[1][2]),
              edges[0][0] * edges[1][1] - edges[0][1] * edges[1][0]);
    return isfinite(area) ? area : 0;
}

/* sums[i]: the area of triangles before i and of i. */
static double *sum_areas(const struct ply *mesh)
{
    double *sums = tree_need(mesh->triangle_count, sizeof *sums), sum = 0;
    for (uint32_t i = 0; i < mesh->triangle_count; i++)
        sums[i] = sum += triangle_area(mesh, i);
    return sums;
}

static struct sample draw(const struct ply *mesh, const double *sums, struct random *random)
{
    struct sample sample = {.triangle = 0};
    uint32_t low = 0, high = mesh->triangle_count - 1;
    double at = random_between(random, 0, sums[high]), u = random_between(random, 0, 1), v = random_between(random, 0, 1);
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (sums[middle] > at)
            high = middle;
        else
            low = middle + 1;
    }
    sample.triangle = low;
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    const uint32_t *corners = mesh->indices + (size_t)3 * low;
    for (int axis = 0; axis < 3; axis++) {
        double a = mesh->positions[(size_t)3 * corners[0] + (size_t)axis], b = mesh->positions[(size_t)3 * corners[1] + (size_t)axis];
        double c = mesh->positions[(size_t)3 * corners[2] + (size_t)axis], value = (1 - u - v) * a + u * b + v * c;
        /* Rounding must not take it out of the triangle's own box. */
        sample.point[axis] = fmin(fmax(value, fmin(fmin(a, b), c)), fmax(fmax(a, b), c));
    }
    return sample;
}

double tree_overlap(const struct tree *tree, const struct ply *mesh, uint32_t samples)
{
    double *sums = sum_areas(mesh), cost = 0;
    struct random random = {5};
    if (tree->node_count && mesh->triangle_count && sums[mesh->triangle_count - 1] > 0)
        for (uint32_t i = 0; i < samples; i++) {
            struct sample sample = draw(mesh, sums, &random);
            bool belongs = false;
            cost += overlap_below(tree, 0, &sample, &belongs);
        }
    free(sums);
    return cost / samples;
}
