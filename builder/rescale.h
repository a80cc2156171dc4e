/* SPDX-License-Identifier: Apache-2.0 */
/*
 * rescale.h - builders work on moderate numbers: squares of what is far from 1 leave float's range. Scenes out of
 * theirs are scaled by a power of two, and the tree gets the true boxes afterwards.
 */
#ifndef BVHD_RESCALE_H
#define BVHD_RESCALE_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "builder/format/ir.h"
#include "builder/input/primitive.h"

/* True when the largest magnitude of any coordinate is not 0 and outside 2^-20 .. 2^40. */
bool rescale_is_needed(const struct box *bounds);

/*
 * Scales all refs, and bounds and centroids with them, so that the largest magnitude is in [1, 2). What gets too small
 * to tell apart is flat. False when cancelled.
 */
bool rescale_refs(struct primitive_refs *refs, const struct build_context *context);

/*
 * Gives all nodes of a tree over scaled refs, without spatial splits, the boxes of their primitives. False when
 * cancelled.
 */
bool rescale_restore(const struct canonical *canonical, const struct build_context *context, struct ir *ir);

#endif
