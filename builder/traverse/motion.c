/* SPDX-License-Identifier: Apache-2.0 */
/* motion.c - the matrices of motion instances at the time of a ray. */
#include "builder/traverse/motion.h"

#include <math.h>

/* The numbers of VkSRTDataNV, in its order. */
enum { SX, SHEAR_A, SHEAR_B, PIVOT_X, SY, SHEAR_C, PIVOT_Y, SZ, PIVOT_Z, QX, QY, QZ, QW, TX, TY, TZ, SRT_NUMBERS };

enum { MATRIX_NUMBERS = 12 };

/* Gives the rotation of a quaternion, which counts as divided by its length. Returns false if it has no length. */
static bool rotation_of(const float srt[SRT_NUMBERS], double ret_rotation[3][3])
{
    double x = srt[QX], y = srt[QY], z = srt[QZ], w = srt[QW];
    const double length = sqrt(x * x + y * y + z * z + w * w);
    if (!(length > 0 && isfinite(length)))
        return false;
    x /= length;
    y /= length;
    z /= length;
    w /= length;
    const double rotation[3][3] = {
        {1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
        {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
        {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)},
    };
    memcpy(ret_rotation, rotation, sizeof rotation);
    return true;
}

static bool compose(const float srt[SRT_NUMBERS], float ret_matrix[MATRIX_NUMBERS])
{
    const double scale[3][4] = {
        {srt[SX], srt[SHEAR_A], srt[SHEAR_B], srt[PIVOT_X]},
        {0, srt[SY], srt[SHEAR_C], srt[PIVOT_Y]},
        {0, 0, srt[SZ], srt[PIVOT_Z]},
    };
    double rotation[3][3];
    if (!rotation_of(srt, rotation))
        return false;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++) {
            double sum = column == 3 ? srt[TX + row] : 0;
            for (int k = 0; k < 3; k++)
                sum += rotation[row][k] * scale[k][column];
            ret_matrix[4 * row + column] = (float)sum;
        }
    return true;
}

bool motion_matrix(const struct portable_moving_instance *instance, float time, float ret_matrix[MATRIX_NUMBERS])
{
    const struct motion_weights at = motion_weights_at(time);
    float numbers[SRT_NUMBERS];
    if (instance->motion == MOTION_STATIC) {
        memcpy(ret_matrix, instance->start, MATRIX_NUMBERS * sizeof *ret_matrix);
        return true;
    }
    for (int i = 0; i < SRT_NUMBERS; i++)
        numbers[i] = motion_number(instance->start[i], instance->end[i], at);
    if (instance->motion == MOTION_SRT)
        return compose(numbers, ret_matrix);
    memcpy(ret_matrix, numbers, MATRIX_NUMBERS * sizeof *ret_matrix);
    return true;
}
