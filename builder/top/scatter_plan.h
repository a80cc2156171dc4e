/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scatter_plan.h - the planes between pieces: a tree of them, found on a sample by binned SAH, and the cells of space
 * that they leave.
 */
#ifndef BVHD_SCATTER_PLAN_H
#define BVHD_SCATTER_PLAN_H

#include "proto/base/parallel.h"
#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

enum { SCATTER_PIECES_MAX = 256, SCATTER_NODES_MAX = 2 * SCATTER_PIECES_MAX - 1 };

/*
 * Refs that are not below the threshold go to the second child. A leaf is its own child, and nothing is beyond its
 * threshold.
 */
struct scatter_node {
    float threshold;
    uint32_t axis, child;
    uint32_t piece; /* of a leaf */
};

/*
 * Of a piece: where the centroids (min + max) of its refs are, not below `low`, below `high`. Any fourth lane is
 * inside.
 */
struct scatter_cell {
    vec4 low, high;
};

/* Children follow their parents. Pieces are numbered in the order of leaves, first children first. */
struct scatter_plan {
    struct scatter_node nodes[SCATTER_NODES_MAX];
    struct scatter_cell cells[SCATTER_PIECES_MAX];
    uint32_t node_count, piece_count;
    uint32_t levels; /* planes on the longest way to a leaf */
};

/*
 * Parts of more than `enough` refs of the sample are divided, as long as there may be more pieces and there is a plane
 * with refs on both sides. The sample is put into another order. The same for any number of threads.
 */
void scatter_plan_make(struct primitive_ref *sample, uint32_t count, uint32_t enough, const struct parallel *parallel,
                       struct scatter_plan *ret_plan);

#endif
