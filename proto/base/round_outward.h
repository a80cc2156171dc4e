/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_outward.h - rounds bounds from double to float so that a box of floats contains the box of doubles: minima
 * downward, maxima upward.
 */
#ifndef BVHD_ROUND_OUTWARD_H
#define BVHD_ROUND_OUTWARD_H

#include <stdint.h>
#include <string.h>

/*
 * Returns the float that is `steps` floats above, without a branch, because the direction of rounding is unpredictable.
 * As integers floats have their own order, if the bits of negative ones are inverted; there -0 comes before 0. No step
 * leads away from infinity or a NaN.
 */
static inline float round_outward_step(float value, int steps)
{
    int32_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits ^= bits >> 31 & INT32_MAX;
    bits += steps;
    bits ^= bits >> 31 & INT32_MAX;
    memcpy(&value, &bits, sizeof bits);
    return value;
}

/* Returns the largest float that is at most `value`. NaN stays NaN. */
static inline float round_down(double value)
{
    const float rounded = (float)value; /* -0 for a number that is too small and negative */
    return round_outward_step(rounded, -((double)rounded > value));
}

/* Returns the smallest float that is at least `value`. NaN stays NaN. */
static inline float round_up(double value)
{
    const float rounded = (float)value;
    return round_outward_step(rounded, (double)rounded < value);
}

#endif
