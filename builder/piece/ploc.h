/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ploc.h - our builder of a piece from below: parallel locally-ordered clustering (Meister and Bittner 2018), on one
 * thread.
 *
 * Leaves are cut along a Morton curve (cluster_tree.h); then, round by round, each cluster looks among its neighbours
 * on the curve for the one with which it makes the smallest box, and those that chose each other become one. Should few
 * find a partner, the rest is divided from above (binned.h), so that no input is slow.
 */
#ifndef BVHD_PLOC_H
#define BVHD_PLOC_H

#include "builder/piece/cluster_tree.h"

/* A cluster_joiner. */
enum bvhd_status ploc_join(struct cluster_tree *tree, struct memory *memory, uint32_t *ret_root);

#endif
