/* SPDX-License-Identifier: Apache-2.0 */
/*
 * binned.h - our builder of a piece from above, on one thread: leaves cut along a Morton curve (cluster_tree.h) are
 * divided by binned SAH (bins.h), and by a full sweep (full_sweep.h) once few are left. It is faster than clustering
 * from below wherever that looks further than a step or two, and its trees overlap less.
 */
#ifndef BVHD_BINNED_H
#define BVHD_BINNED_H

#include "builder/piece/cluster_tree.h"

/* A cluster_joiner. */
enum bvhd_status binned_join(struct cluster_tree *tree, struct memory *memory, uint32_t *ret_root);

/* The same for `count` >= 1 nodes without a parent; all leaves when `nodes` is NULL. */
enum bvhd_status binned_join_nodes(struct cluster_tree *tree, const uint32_t *nodes, uint32_t count,
                                   struct memory *memory, uint32_t *ret_root);

#endif
