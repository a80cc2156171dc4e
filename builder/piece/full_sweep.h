/* SPDX-License-Identifier: Apache-2.0 */
/*
 * full_sweep.h - builds the tree of a few boxes top-down by SAH, trying every cut between neighbours on all three axes.
 * For few boxes this is faster than bins (bins.h), and finds cuts that bottom-up clustering does not.
 *
 * A side of a cut costs its half area times its number of boxes.
 */
#ifndef BVHD_FULL_SWEEP_H
#define BVHD_FULL_SWEEP_H

#include "builder/kernel/primitive_ref.h"

enum { FULL_SWEEP_MOST = 48 };

/*
 * An inner node, by the numbers of its two children. A number below the count of boxes is a box; others are that count
 * plus the index of an earlier pair.
 */
struct full_sweep_pair {
    uint8_t left, right;
};

/*
 * Builds the tree of 1 .. FULL_SWEEP_MOST refs, whose magnitudes are at most 2^40. ret_pairs has room for count - 1
 * pairs; the last one is the root. The result is the same on every machine.
 */
void full_sweep(const struct primitive_ref *refs, uint32_t count, struct full_sweep_pair *ret_pairs);

#endif
