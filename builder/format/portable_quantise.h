/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_quantise.h - eight boxes to the bytes of one compressed node, outward, with 1/64 of a step to spare on each side.
 *
 * Per axis: the smallest power of two as step with which all boxes fit into 0 .. 255 from a float origin. Everything is exact: whatever floats
 * come in, origin + lo * step <= min - step / 64 and max + step / 64 <= origin + hi * step hold for the real numbers. Two exceptions: an axis on
 * which all boxes are flat at one coordinate has step 0 and holds it exactly; and where no float lies below (min within step / 64 of -FLT_MAX)
 * the origin is -FLT_MAX, without anything to spare on that side.
 */
#ifndef BVHD_PORTABLE_QUANTISE_H
#define BVHD_PORTABLE_QUANTISE_H

#include "portable.h"

/* min[axis][slot], max[axis][slot]; what stands in empty slots must be the box of another slot. */
struct portable_boxes {
    float min[3][8], max[3][8];
};

/* Fills origin, exponent, lo and hi; slots whose bit in `occupied` is clear become lo 255, hi 0. `occupied` is not 0. */
void portable_quantise(const struct portable_boxes *boxes, unsigned occupied, struct portable_node *ret_node);

#endif
