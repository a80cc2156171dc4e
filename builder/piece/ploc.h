/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ploc.h - builds a piece's tree bottom-up, on one thread, for quality fast: parallel locally-ordered clustering (PLOC,
 * Meister and Bittner 2018).
 *
 * Leaves are cut along a Morton curve (cluster_tree.h). Then, round by round, each cluster finds among its neighbours
 * on the curve the one with which it has the smallest common box, and clusters that chose each other are joined. If few
 * of them do, the remaining clusters are divided top-down (binned.h), so that no input is slow.
 */
#ifndef BVHD_PLOC_H
#define BVHD_PLOC_H

#include "builder/piece/cluster_tree.h"

/* Joins all leaves; a cluster_joiner. */
enum bvhd_status ploc_join(struct cluster_tree *tree, struct memory *memory, uint32_t *ret_root);

#endif
