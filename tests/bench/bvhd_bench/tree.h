/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tree.h - a tree of anybody's, by which builders are compared: of any arity, with boxes in float.
 *
 * Node 0 is the root; children of a node are adjacent and follow it. Figures count 1 for an inner node and 1 for a
 * triangle.
 */
#ifndef BVHD_BENCH_TREE_H
#define BVHD_BENCH_TREE_H

#include "builder/format/ir.h"
#include "tests/support/scene/ply.h"
#include "builder/traverse/traverse.h"

struct tree_node {
    struct box box;
    uint32_t first; /* child, or ref of a leaf */
    uint32_t children; /* 0: a leaf */
    uint32_t refs; /* of a leaf */
};

struct tree {
    uint32_t node_count, ref_count;
    struct tree_node *nodes; /* malloc */
    uint32_t *refs; /* primitives; malloc */
};

/* calloc that ends the program when there is no memory. */
void *tree_need(size_t count, size_t size);

struct tree tree_from_ir(const struct ir *ir);
/* NULL-safe, idempotent. */
void tree_finish(struct tree *tree);

/* Levels; 0 when empty. */
uint32_t tree_depth(const struct tree *tree);

/* Areas of inner nodes, and of leaves times their refs, over the root's area; 0 for a tree without area. */
double tree_sah(const struct tree *tree);

/*
 * End-point overlap (Aila 2013): how much is spent at a point of the surface on nodes that it lies in but whose subtree
 * it does not belong to. Estimated at `samples` points, uniform over the surface; the same ones for every tree of a
 * mesh.
 */
double tree_overlap(const struct tree *tree, const struct ply *mesh, uint32_t samples);

/* Closest hits, children by distance: inner nodes whose children are tested, and triangle tests, a ray. */
struct tree_work {
    double inner, triangles;
};
struct tree_work tree_trace(const struct tree *tree, const struct ply *mesh, const struct ray *rays, uint32_t count);

#endif
