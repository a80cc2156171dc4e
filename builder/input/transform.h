/* SPDX-License-Identifier: Apache-2.0 */
/* transform.h - a geometry's 3x4 matrix applied to its positions (row F05). */
#ifndef BVHD_TRANSFORM_H
#define BVHD_TRANSFORM_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* The one NaN that computed coordinates have: processors and compilers differ in which one comes out. */
static inline float transform_nan(void)
{
    const uint32_t bits = UINT32_C(0x7fc00000);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Row-major; -0 counts as 0. */
bool transform_is_identity(const float matrix[12]);

/* In place: ((m0 x + m1 y) + m2 z) + m3 for each row, in double, rounded to float once; NaNs become transform_nan(). */
void transform_points(const float matrix[12], float *points, uint64_t count);

#endif
