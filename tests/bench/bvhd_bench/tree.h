/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tree.h - a neutral tree by which builders are compared: of any arity, with boxes in float.
 *
 * Node 0 is the root; the children of a node are adjacent and follow it. In all figures an inner node costs 1, and so
 * does a triangle.
 */
#ifndef BVHD_BENCH_TREE_H
#define BVHD_BENCH_TREE_H

#include "builder/format/ir.h"
#include "tests/support/scene/ply.h"
#include "builder/traverse/traverse.h"

struct tree_node {
    struct box box;
    uint32_t first; /* index of the first child, or of a leaf's first ref */
    uint32_t children; /* number of children; 0: a leaf */
    uint32_t refs; /* number of refs of a leaf */
};

struct tree {
    uint32_t node_count, ref_count;
    struct tree_node *nodes; /* malloc */
    uint32_t *refs; /* primitive numbers; malloc */
};

/* Like calloc, but ends the program when there is no memory. */
void *tree_need(size_t count, size_t size);

struct tree tree_from_ir(const struct ir *ir);
/* Frees the arrays. Accepts NULL, and a tree that is finished already. */
void tree_finish(struct tree *tree);

/* The number of levels; 0 for an empty tree. */
uint32_t tree_depth(const struct tree *tree);

/*
 * Sum of the areas of inner nodes, and of the areas of leaves times their refs, over the root's area; 0 for a tree
 * without area.
 */
double tree_sah(const struct tree *tree);

/*
 * End-point overlap (Aila 2013): the mean cost, at a point of the surface, of the nodes whose box contains the point
 * but whose subtree does not contain its triangle. It is estimated at `samples` points, drawn uniformly over the
 * surface, which are the same for every tree of a mesh.
 */
double tree_overlap(const struct tree *tree, const struct ply *mesh, uint32_t samples);

/*
 * Mean costs of a closest-hit ray that visits children by distance: inner nodes whose children are tested, and triangle
 * tests.
 */
struct tree_work {
    double inner, triangles;
};
struct tree_work tree_trace(const struct tree *tree, const struct ply *mesh, const struct ray *rays, uint32_t count);

#endif
