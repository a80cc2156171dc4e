/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>

#include "tests/bench/bvhd_bench/tree.h"
#include "builder/traverse/triangle.h"

struct visit {
    double near;
    uint32_t node;
};

struct walk {
    const struct tree *tree;
    const struct ply *mesh;
    struct visit *stack;
    uint32_t height;
    struct triangle_ray triangle_ray;
    double origin[3], inverse[3];
    double tmin, best;
    struct tree_work work;
};

/*
 * The distance at which the ray enters the box; INFINITY when it does not enter before `best`. NaNs, from rays within a
 * plane of the box, leave the other bound unchanged.
 */
static double entry(const struct walk *walk, const struct box *box)
{
    double near = walk->tmin, far = walk->best;
    for (int axis = 0; axis < 3; axis++) {
        double a = (box->min[axis] - walk->origin[axis]) * walk->inverse[axis];
        double b = (box->max[axis] - walk->origin[axis]) * walk->inverse[axis];
        near = fmax(near, fmin(a, b));
        far = fmin(far, fmax(a, b) * (1 + 1e-14));
    }
    return near <= far ? near : INFINITY;
}

static void test_leaf(struct walk *walk, const struct tree_node *leaf)
{
    for (uint32_t k = 0; k < leaf->refs; k++) {
        const uint32_t *corners = walk->mesh->indices + (size_t)3 * walk->tree->refs[leaf->first + k];
        struct triangle_hit hit;
        const float *positions = walk->mesh->positions;
        if (triangle_intersect(&walk->triangle_ray, positions + (size_t)3 * corners[0],
                               positions + (size_t)3 * corners[1], positions + (size_t)3 * corners[2], &hit) &&
            hit.t > walk->tmin && hit.t < walk->best)
            walk->best = hit.t;
    }
    walk->work.triangles += leaf->refs;
}

/* Pushes the children that the ray enters, the closest last. */
static void enter_children(struct walk *walk, const struct tree_node *node)
{
    uint32_t begin = walk->height;
    walk->work.inner += 1;
    for (uint32_t k = 0; k < node->children; k++) {
        struct visit visit = {entry(walk, &walk->tree->nodes[node->first + k].box), node->first + k};
        uint32_t at = walk->height;
        if (visit.near == INFINITY)
            continue;
        for (; at > begin && walk->stack[at - 1].near < visit.near; at--)
            walk->stack[at] = walk->stack[at - 1];
        walk->stack[at] = visit;
        walk->height++;
    }
}

static void trace_ray(struct walk *walk, const struct ray *ray)
{
    double direction[3];
    for (int axis = 0; axis < 3; axis++) {
        walk->origin[axis] = ray->origin[axis];
        direction[axis] = ray->direction[axis];
        walk->inverse[axis] = 1 / direction[axis];
    }
    triangle_ray_init(walk->origin, direction, &walk->triangle_ray);
    walk->tmin = ray->tmin;
    walk->best = ray->tmax;
    walk->height = 0;
    walk->stack[walk->height++] = (struct visit){0, 0};
    while (walk->height > 0) {
        struct visit visit = walk->stack[--walk->height];
        const struct tree_node *node = &walk->tree->nodes[visit.node];
        if (visit.near > walk->best)
            continue;
        if (node->children)
            enter_children(walk, node);
        else
            test_leaf(walk, node);
    }
}

struct tree_work tree_trace(const struct tree *tree, const struct ply *mesh, const struct ray *rays, uint32_t count)
{
    struct walk walk = {.tree = tree, .mesh = mesh};
    if (tree->node_count == 0 || count == 0)
        return walk.work;
    walk.stack = tree_need((size_t)tree_depth(tree) * 8 + 8, sizeof *walk.stack);
    for (uint32_t i = 0; i < count; i++)
        trace_ray(&walk, &rays[i]);
    free(walk.stack);
    return (struct tree_work){walk.work.inner / count, walk.work.triangles / count};
}
