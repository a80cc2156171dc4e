/* SPDX-License-Identifier: Apache-2.0 */
/*
 * binned.h - our builder of a piece from above, on one thread: leaves cut along a Morton curve (cluster_tree.h) are divided by binned SAH (bins.h), and
 * by a full sweep (full_sweep.h) once few are left. It is faster than clustering from below wherever that looks further than a step or two, and its
 * trees overlap less.
 */
#ifndef BVHD_BINNED_H
#define BVHD_BINNED_H

#include "cluster_tree.h"

/* *ret_ir is made by ir_init from `memory`; ret_depth, ret_cost: its ir_depth, ir_cost. The same bytes on every machine. BVHD_NO_MEMORY, BVHD_CANCELLED. */
enum bvhd_status binned_build(const struct cluster_request *request, struct memory *memory, struct ir *ret_ir, uint32_t *ret_depth,
                              double *ret_cost, struct bvhd_error *error);

/* Joins `count` >= 1 nodes without a parent, or all leaves when `nodes` is NULL, to one, whose number is *ret_root. BVHD_NO_MEMORY, BVHD_CANCELLED. */
enum bvhd_status binned_join(struct cluster_tree *tree, const uint32_t *nodes, uint32_t count, struct memory *memory,
                             uint32_t *ret_root);

#endif
