/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/srt.h"

#include <math.h>
#include <string.h>

void srt_turn(const double quaternion[4], const float srt[SRT_NUMBERS], double ret_matrix[12])
{
    const double x = quaternion[0], y = quaternion[1], z = quaternion[2], w = quaternion[3];
    const double rotation[3][3] = {
        {1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
        {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
        {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)},
    };
    for (int row = 0; row < 3; row++) {
        const double *r = rotation[row];
        ret_matrix[4 * row] = r[0] * srt[SRT_SX];
        ret_matrix[4 * row + 1] = r[0] * srt[SRT_A] + r[1] * srt[SRT_SY];
        ret_matrix[4 * row + 2] = r[0] * srt[SRT_B] + r[1] * srt[SRT_C] + r[2] * srt[SRT_SZ];
        ret_matrix[4 * row + 3] = r[0] * srt[SRT_PVX] + r[1] * srt[SRT_PVY] + r[2] * srt[SRT_PVZ];
    }
}

bool srt_matrix(const float srt[SRT_NUMBERS], float ret_matrix[12])
{
    double quaternion[4], length = 0, matrix[12];
    for (int i = 0; i < 4; i++) {
        quaternion[i] = srt[SRT_QX + i];
        length += quaternion[i] * quaternion[i];
    }
    memset(ret_matrix, 0, 12 * sizeof *ret_matrix);
    length = sqrt(length);
    if (!(length > 0 && isfinite(length)))
        return false;
    for (int i = 0; i < 4; i++)
        quaternion[i] /= length;
    srt_turn(quaternion, srt, matrix);
    for (int i = 0; i < 12; i++)
        ret_matrix[i] = (float)(i % 4 == 3 ? matrix[i] + srt[SRT_TX + i / 4] : matrix[i]);
    return true;
}
