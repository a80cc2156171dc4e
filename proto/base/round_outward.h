/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_outward.h - rounds bounds from double to float so that a box of floats contains the box of doubles: minima
 * downward, maxima upward.
 */
#ifndef BVHD_ROUND_OUTWARD_H
#define BVHD_ROUND_OUTWARD_H

#include <math.h>

/* Returns the largest float that is at most `value`. NaN stays NaN. */
static inline float round_down(double value)
{
    float rounded = (float)value;
    return (double)rounded > value ? nextafterf(rounded, -INFINITY) : rounded;
}

/* Returns the smallest float that is at least `value`. NaN stays NaN. */
static inline float round_up(double value)
{
    float rounded = (float)value;
    return (double)rounded < value ? nextafterf(rounded, INFINITY) : rounded;
}

#endif
