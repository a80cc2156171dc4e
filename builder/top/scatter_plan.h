/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scatter_plan.h - finds the planes between pieces on a sample of the refs, by binned SAH: a tree of planes, and the
 * cells of space between them.
 */
#ifndef BVHD_SCATTER_PLAN_H
#define BVHD_SCATTER_PLAN_H

#include "proto/base/parallel.h"
#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

enum { SCATTER_PIECES_MAX = 256, SCATTER_NODES_MAX = 2 * SCATTER_PIECES_MAX - 1 };

/*
 * A plane, or a leaf. Refs whose centroid on `axis` is not below the threshold go to the second child. A leaf is its
 * own child and has an infinite threshold, so further steps stay in it.
 */
struct scatter_node {
    float threshold;
    uint32_t axis, child;
    uint32_t piece; /* number of a leaf's piece */
};

/*
 * The region of one piece: its refs have centroids (min + max) not below `low` and below `high`. The fourth lane
 * accepts every value.
 */
struct scatter_cell {
    vec4 low, high;
};

/* A tree of planes. Children follow their parents; pieces are numbered in the order of leaves, first children first. */
struct scatter_plan {
    struct scatter_node nodes[SCATTER_NODES_MAX];
    struct scatter_cell cells[SCATTER_PIECES_MAX];
    uint32_t node_count, piece_count;
    uint32_t levels; /* planes on the longest path to a leaf */
};

/*
 * Makes the plan: divides every part of the sample that has more than `enough` refs, as long as more pieces are allowed
 * and a plane has refs on both sides. Reorders the sample, or copies it to `spare`, which has room for it twice and may
 * be NULL. The result is the same for any number of threads. Allocates nothing and cannot fail.
 */
void scatter_plan_make(struct primitive_ref *sample, struct primitive_ref *spare, uint32_t count, uint32_t enough,
                       const struct parallel *parallel, struct scatter_plan *ret_plan);

#endif
