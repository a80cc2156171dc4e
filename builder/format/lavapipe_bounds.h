/* SPDX-License-Identifier: Apache-2.0 */
/* lavapipe_bounds.h - boxes as the driver computes them, and our own made large enough for its arithmetic. */
#ifndef BVHD_LAVAPIPE_BOUNDS_H
#define BVHD_LAVAPIPE_BOUNDS_H

#include <stdatomic.h>
#include <stdbool.h>

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "proto/base/parallel.h"

/* The driver's union: of what compares equal the second, which matters for the sign of zeros. */
struct box lavapipe_bounds_join(const struct box *first, const struct box *second);

/*
 * The driver's box of flat primitive `id`, which is no null instance, to the bit. An instance's: the bounds of what it
 * names through its matrix, in float; not finite where that overflows.
 */
struct box lavapipe_bounds_leaf(const struct canonical *canonical, uint32_t id);

/*
 * As layout.inflate_boxes. The driver tests boxes in float, without a margin. A ray finds a triangle through any tree
 * just as it does through the driver's own, because the boxes above a leaf contain the leaf's, and rounding keeps that
 * order; so leaves must not be smaller than the driver's:
 *  - boxes of instances, rounded outward from double, grow to contain what the driver computes in float;
 *  - those of split references grow by 2^-16 of the whole structure's largest side, but not beyond the triangle: rays that start within some 64 such
 *    sides round by less. Where two parts meet no ray slips through.
 */
bool lavapipe_bounds_inflate(const struct canonical *canonical, const struct parallel *parallel,
                             const atomic_bool *cancel, struct ir *ir);

#endif
