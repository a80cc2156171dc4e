/* SPDX-License-Identifier: Apache-2.0 */
/*
 * full_sweep.h - the tree of a few boxes from above by SAH, with every cut between neighbours looked at on all three
 * axes: where there are few, that is faster than bins (bins.h), and finds what clustering from below does not.
 *
 * A side costs its half area times its boxes.
 */
#ifndef BVHD_FULL_SWEEP_H
#define BVHD_FULL_SWEEP_H

#include "builder/kernel/primitive_ref.h"

enum { FULL_SWEEP_MOST = 48 };

/*
 * Two that become one: numbers below the count of boxes are these, others are that count plus the index of an earlier
 * pair.
 */
struct full_sweep_pair {
    uint8_t left, right;
};

/*
 * Of 1 .. FULL_SWEEP_MOST refs, whose magnitudes are at most 2^40. ret_pairs has room for count - 1, of which the last
 * one is the root. The same on every machine.
 */
void full_sweep(const struct primitive_ref *refs, uint32_t count, struct full_sweep_pair *ret_pairs);

#endif
