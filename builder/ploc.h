/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ploc.h - our builder of a piece from below: parallel locally-ordered clustering (Meister and Bittner 2018), on one thread.
 *
 * Leaves are cut along a Morton curve (cluster_tree.h); then, round by round, each cluster looks among its neighbours on the curve for the one with
 * which it makes the smallest box, and those that chose each other become one. Should few find a partner, the rest is divided from above (binned.h), so
 * that no input is slow.
 */
#ifndef BVHD_PLOC_H
#define BVHD_PLOC_H

#include "cluster_tree.h"

/* *ret_ir is made by ir_init from `memory`; ret_depth, ret_cost: its ir_depth, ir_cost. The same bytes on every machine. BVHD_NO_MEMORY, BVHD_CANCELLED. */
enum bvhd_status ploc_build(const struct cluster_request *request, struct memory *memory, struct ir *ret_ir, uint32_t *ret_depth,
                            double *ret_cost, struct bvhd_error *error);

#endif
