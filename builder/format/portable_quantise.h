/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_quantise.h - rounds eight boxes outward to the bytes of one compressed node, with a margin of 1/64 of a step
 * on each side.
 *
 * The step of an axis is the smallest power of two with which all boxes fit into 0 .. 255 from a float origin. The
 * result is exact: for all float inputs, origin + lo * step <= min - step / 64 and max + step / 64 <= origin + hi *
 * step hold in real numbers. There are two exceptions. An axis on which all boxes are flat at one coordinate has step 0
 * and stores that coordinate exactly. Where no float lies below (min within step / 64 of -FLT_MAX), the origin is
 * -FLT_MAX, without a margin on that side.
 *
 * A node of a structure that moves has two boxes for each child, of t = 0 and of t = 1, on one grid, and all of this
 * holds for both of them.
 */
#ifndef BVHD_PORTABLE_QUANTISE_H
#define BVHD_PORTABLE_QUANTISE_H

#include "builder/format/portable.h"

/* min[axis][slot], max[axis][slot]; empty slots must hold the box of another slot. */
struct portable_boxes {
    float min[3][8], max[3][8];
};

/*
 * In steps: the margin that the format promises, plus a bit more than the largest rounding error of the writer.
 * Differences of floats are rounded to double once (relative error 2^-53, at most 255 steps), so that the error of
 * coordinates in steps is below 2^-44.
 */
#define PORTABLE_MARGIN (1.0 / 64 + 0x1p-40)

/* An extent times this is the step with which it just fits, apart from rounding, which a later check detects. */
#define PORTABLE_PER_STEPS (1 / (255 - 2 * PORTABLE_MARGIN))

/*
 * Fills origin, exponent, lo and hi; slots whose bit in `occupied` is clear become lo 255, hi 0. `occupied` is not 0.
 */
void portable_quantise(const struct portable_boxes *boxes, unsigned occupied, struct portable_node *ret_node);

/*
 * Does the same from pointers to boxes; empty slots point to the box of another slot. `avx2` (portable_has_avx2)
 * selects the fastest version for the machine.
 */
void portable_quantise_boxes(const struct box *const boxes[8], unsigned occupied, bool avx2,
                             struct portable_node *ret_node);

/* The same for nodes of structures that move. A slot is empty in both arrays, or in none. */
void portable_quantise_moving(const struct portable_boxes *start, const struct portable_boxes *end, unsigned occupied,
                              struct portable_moving_node *ret_node);
void portable_quantise_moving_boxes(const struct box *const start[8], const struct box *const end[8], unsigned occupied,
                                    bool avx2, struct portable_moving_node *ret_node);

/*
 * Returns whether this machine has AVX2, which the following functions need. They return false, and fill nothing, for
 * the rare nodes that they cannot handle.
 */
bool portable_has_avx2(void);
bool portable_quantise_avx2(const struct box *const boxes[8], unsigned occupied, struct portable_node *ret_node);
bool portable_quantise_moving_avx2(const struct box *const start[8], const struct box *const end[8], unsigned occupied,
                                   struct portable_moving_node *ret_node);

#endif
