/* SPDX-License-Identifier: Apache-2.0 */
/*
 * rescale.h - scales scenes of extreme magnitude to a moderate one by a power of two, because builders square
 * coordinates, and squares of very large or very small ones leave float's range. After the build the tree gets the
 * exact boxes of its primitives back (top/restore.h).
 */
#ifndef BVHD_RESCALE_H
#define BVHD_RESCALE_H

#include "builder/context.h"
#include "builder/input/primitive.h"

/* True when the largest magnitude of any coordinate in `bounds` is not 0 and lies outside 2^-20 .. 2^40. */
bool rescale_is_needed(const struct box *bounds);

/*
 * Scales all refs and their bounds and centroids in place, so that the largest magnitude is in [1, 2). Coordinates that
 * become too small for a float are rounded, and refs that differ only there become equal. Runs on context->parallel.
 * Returns false when cancelled.
 */
bool rescale_refs(struct primitive_refs *refs, const struct build_context *context);

#endif
