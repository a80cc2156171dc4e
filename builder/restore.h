/* SPDX-License-Identifier: Apache-2.0 */
/*
 * restore.h - gives the nodes of a tree the boxes of their primitives: builders may have seen others, those of a scaled
 * scene (rescale.h), or of what moves those that hold each primitive at all times.
 */
#ifndef BVHD_RESTORE_H
#define BVHD_RESTORE_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "builder/format/ir.h"

/*
 * Replaces all boxes of the tree by the exact ones. If anything in the structure moves, the tree then has two keys: the
 * boxes at t = 0 and at t = 1. The tree must not contain spatial splits. The leaves run on context->parallel, the nodes
 * above them on the calling thread. Returns BVHD_NO_MEMORY, or BVHD_CANCELLED.
 */
enum bvhd_status restore_boxes(const struct canonical *canonical, const struct build_context *context, struct ir *ir,
                               struct bvhd_error *error);

#endif
