/* SPDX-License-Identifier: Apache-2.0 */
/* transform.h - applies a geometry's 3x4 matrix (transformData) to its positions. */
#ifndef BVHD_TRANSFORM_H
#define BVHD_TRANSFORM_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "proto/base/box.h"

/*
 * Returns the only NaN that computed coordinates contain: processors and compilers differ in which NaN an operation
 * gives.
 */
static inline float transform_nan(void)
{
    const uint32_t bits = UINT32_C(0x7fc00000);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Compares a row-major matrix with the identity; -0 counts as 0. */
bool transform_is_identity(const float matrix[12]);

/*
 * Transforms `count` tightly packed points in place: ((m0 x + m1 y) + m2 z) + m3 for each row, in double, rounded to
 * float once. A NaN becomes transform_nan().
 */
void transform_points(const float matrix[12], float *points, uint64_t count);

/*
 * Finds the bounds of a box under a row-major 3x4 matrix. They contain the exact ones, and are larger by at most 2^-47
 * of the sum of all products' magnitudes.
 */
void transform_bounds(const double matrix[12], const struct box *box, double ret_min[3], double ret_max[3]);

#endif
