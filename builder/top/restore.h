/* SPDX-License-Identifier: Apache-2.0 */
/*
 * restore.h - gives the nodes of a piece's tree the boxes of their primitives: builders may have seen others, those of
 * a scaled scene (rescale.h), or of what moves those that hold each primitive at all times.
 *
 * This is done while the tree and its primitives are in the cache, before the piece is collapsed.
 */
#ifndef BVHD_RESTORE_H
#define BVHD_RESTORE_H

#include <stdatomic.h>

#include "builder/format/canonical.h"
#include "builder/format/ir.h"

/*
 * Replaces all boxes of the tree by the exact ones. If anything in the structure moves, the tree then has two keys: the
 * boxes at t = 0 and at t = 1. The tree must not contain spatial splits. *ret_cost is its ir_cost then. Runs on the
 * calling thread. `cancel` may be NULL. Returns BVHD_NO_MEMORY, or BVHD_CANCELLED.
 */
enum bvhd_status restore_boxes(const struct canonical *canonical, const atomic_bool *cancel, struct ir *ir,
                               double *ret_cost);

#endif
