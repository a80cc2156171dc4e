/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/motion.h"

#include <math.h>
#include <string.h>

#include "proto/base/geometry.h"

void motion_turn(const double quaternion[4], const float srt[MOTION_SRT_NUMBERS], double ret_matrix[12])
{
    const double x = quaternion[0], y = quaternion[1], z = quaternion[2], w = quaternion[3];
    const double rotation[3][3] = {
        {1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
        {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
        {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)},
    };
    for (int row = 0; row < 3; row++) {
        const double *r = rotation[row];
        ret_matrix[4 * row] = r[0] * srt[MOTION_SX];
        ret_matrix[4 * row + 1] = r[0] * srt[MOTION_A] + r[1] * srt[MOTION_SY];
        ret_matrix[4 * row + 2] = r[0] * srt[MOTION_B] + r[1] * srt[MOTION_C] + r[2] * srt[MOTION_SZ];
        ret_matrix[4 * row + 3] = r[0] * srt[MOTION_PVX] + r[1] * srt[MOTION_PVY] + r[2] * srt[MOTION_PVZ];
    }
}

bool motion_srt_matrix(const float srt[MOTION_SRT_NUMBERS], float ret_matrix[12])
{
    double quaternion[4], length = 0, matrix[12];
    for (int i = 0; i < 4; i++) {
        quaternion[i] = srt[MOTION_QX + i];
        length += quaternion[i] * quaternion[i];
    }
    memset(ret_matrix, 0, 12 * sizeof *ret_matrix);
    if (length == 0)
        return false;
    length = sqrt(length);
    for (int i = 0; i < 4; i++)
        quaternion[i] /= length;
    motion_turn(quaternion, srt, matrix);
    for (int i = 0; i < 12; i++)
        ret_matrix[i] = (float)(i % 4 == 3 ? matrix[i] + srt[MOTION_TX + i / 4] : matrix[i]);
    return true;
}

bool motion_matrix(uint32_t type, const float *start, const float *end, float time, float ret_matrix[12])
{
    float numbers[MOTION_SRT_NUMBERS];
    const int count = type == MOTION_SRT ? MOTION_SRT_NUMBERS : 12;
    if (type == MOTION_STATIC) {
        memcpy(ret_matrix, start, 12 * sizeof *ret_matrix);
        return true;
    }
    for (int i = 0; i < count; i++)
        numbers[i] = motion_number(start[i], end[i], time);
    if (type == MOTION_SRT)
        return motion_srt_matrix(numbers, ret_matrix);
    memcpy(ret_matrix, numbers, 12 * sizeof *ret_matrix);
    return true;
}
