/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_quantise.h - eight boxes to the bytes of one compressed node, outward, with 1/64 of a step to spare on each
 * side.
 *
 * Per axis: the smallest power of two as step with which all boxes fit into 0 .. 255 from a float origin. Everything is
 * exact: whatever floats come in, origin + lo * step <= min - step / 64 and max + step / 64 <= origin + hi * step hold
 * for the real numbers. Two exceptions: an axis on which all boxes are flat at one coordinate has step 0 and holds it
 * exactly; and where no float lies below (min within step / 64 of -FLT_MAX) the origin is -FLT_MAX, without anything to
 * spare on that side.
 */
#ifndef BVHD_PORTABLE_QUANTISE_H
#define BVHD_PORTABLE_QUANTISE_H

#include "builder/format/portable.h"

/* min[axis][slot], max[axis][slot]; what stands in empty slots must be the box of another slot. */
struct portable_boxes {
    float min[3][8], max[3][8];
};

/*
 * In steps: the spare that the format promises, and a bit more than all rounding of the writer can take away.
 * Differences of floats are rounded to double once (relative error 2^-53, at most 255 steps), so that coordinates in
 * steps are wrong by less than 2^-44.
 */
#define PORTABLE_MARGIN (1.0 / 64 + 0x1p-40)

/* Of an extent: the step with which it just fits, but for rounding, which a check afterwards sees. */
#define PORTABLE_PER_STEPS (1 / (255 - 2 * PORTABLE_MARGIN))

/*
 * Fills origin, exponent, lo and hi; slots whose bit in `occupied` is clear become lo 255, hi 0. `occupied` is not 0.
 */
void portable_quantise(const struct portable_boxes *boxes, unsigned occupied, struct portable_node *ret_node);

/*
 * The same from boxes as they lie in memory; in empty slots stands another slot's. With `avx2` (portable_has_avx2) as
 * fast as the machine can.
 */
void portable_quantise_boxes(const struct box *const boxes[8], unsigned occupied, bool avx2,
                             struct portable_node *ret_node);

/*
 * Whether this machine has AVX2, which portable_quantise_avx2 needs. False from that: not a node for it, and nothing is
 * filled.
 */
bool portable_has_avx2(void);
bool portable_quantise_avx2(const struct box *const boxes[8], unsigned occupied, struct portable_node *ret_node);

#endif
