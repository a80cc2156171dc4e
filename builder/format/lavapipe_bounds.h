/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_bounds.h - computes boxes as the driver computes them, and makes the builder's boxes large enough for the
 * driver's arithmetic.
 */
#ifndef BVHD_LAVAPIPE_BOUNDS_H
#define BVHD_LAVAPIPE_BOUNDS_H

#include <stdatomic.h>
#include <stdbool.h>

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "proto/base/parallel.h"

/*
 * Returns the union as the driver computes it: of two equal values it takes the second, which matters for the sign of
 * zeros.
 */
struct box lavapipe_bounds_join(const struct box *first, const struct box *second);

/*
 * Returns the driver's box of flat primitive `id` to the bit; the primitive is not a null instance. An instance's box
 * is the bounds of its bottom level transformed by its matrix, in float; it is not finite if that overflows.
 */
struct box lavapipe_bounds_leaf(const struct canonical *canonical, uint32_t id);

/* Grows a box to contain the driver's box of an instance, as far as that is finite; NaNs are ignored. */
void lavapipe_bounds_grow(struct box *box, const struct box *drivers);

/*
 * Enlarges boxes for the driver (layout.inflate_boxes). Returns false when cancelled. The driver tests boxes in float,
 * without a margin. A ray finds a triangle through any tree as it does through the driver's own, because the boxes
 * above a leaf contain the leaf's box and rounding preserves that order. Therefore leaf boxes must not be smaller than
 * the driver's:
 * - Boxes of instances, which are rounded outward from double, grow to contain the driver's float result.
 * - Boxes of split references grow by 2^-16 of the whole structure's largest side, but not beyond the triangle. The
 *   rounding errors of rays that start within about 64 such sides are smaller than that, so that no ray slips through
 *   where two parts meet.
 */
bool lavapipe_bounds_inflate(const struct canonical *canonical, const struct parallel *parallel,
                             const atomic_bool *cancel, struct ir *ir);

#endif
