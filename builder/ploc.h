/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ploc.h - our builder of a piece from below: parallel locally-ordered clustering (Meister and Bittner 2018), on one thread.
 *
 * Refs are sorted along a Morton curve and, where that is asked for, cut into leaves; then, round by round, each cluster looks among
 * its neighbours on the curve for the one with which it makes the smallest box, and those that chose each other become one, with a tree
 * rotation where that helps (Kensler 2008). After a number of rounds, or when few find a partner, what is left is divided from above by
 * binned SAH (bins.h) into parts of a hundred clusters, which are merged again. So clustering makes the lower levels, where it is
 * cheaper and better than binning, and bins those above, where a greedy choice is seldom the best one; and no input is slow.
 */
#ifndef BVHD_PLOC_H
#define BVHD_PLOC_H

#include <stdatomic.h>

#include "ir.h"
#include "nearest.h"
#include "primitive.h"

struct ploc_request {
    struct primitive_ref *refs, *scratch; /* `count` each; what they hold afterwards is of no use */
    uint32_t count; /* 1 .. 2^31 / 2 */
    uint32_t leaf_max; /* 1 .. 31; leaves are as large as pays by SAH, up to this */
    uint32_t radius; /* 1 .. NEAREST_MAX: neighbours looked at to either side */
    uint32_t rounds; /* before the rest is divided; UINT32_MAX: as long as they get on */
    /* Not 0: refs are cut into leaves along the curve (leaves.h), and no subtree that fits into a leaf is divided, nothing rotated. */
    float cut_cost;
    const atomic_bool *cancel; /* may be NULL; looked at every few thousand refs */
};

/*
 * Magnitudes are at most 2^40. Refs may be runs (primitive.h). *ret_ir is made by ir_init from `memory`; ret_depth, ret_cost: its
 * ir_depth, ir_cost. The same bytes on every machine. BVHD_NO_MEMORY, BVHD_CANCELLED.
 */
enum bvhd_status ploc_build(const struct ploc_request *request, struct memory *memory, struct ir *ret_ir, uint32_t *ret_depth,
                            double *ret_cost, struct bvhd_error *error);

#endif
