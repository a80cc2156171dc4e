/* SPDX-License-Identifier: Apache-2.0 */
/*
 * binned.h - builds a piece's tree top-down, on one thread, for quality balanced: leaves that were cut along a Morton
 * curve (cluster_tree.h) are divided by binned SAH (bins.h), and by a full sweep (full_sweep.h) once few are left. This
 * is faster than PLOC (ploc.h) with a search radius of more than one or two, and its trees overlap less.
 */
#ifndef BVHD_BINNED_H
#define BVHD_BINNED_H

#include "builder/piece/cluster_tree.h"

/* Joins all leaves; a cluster_joiner. */
enum bvhd_status binned_join(struct cluster_tree *tree, struct memory *memory, uint32_t *ret_root);

/*
 * Joins `count` >= 1 nodes without a parent; all leaves when `nodes` is NULL. *ret_root: the number of the root.
 * Returns BVHD_NO_MEMORY or BVHD_CANCELLED.
 */
enum bvhd_status binned_join_nodes(struct cluster_tree *tree, const uint32_t *nodes, uint32_t count,
                                   struct memory *memory, uint32_t *ret_root);

#endif
