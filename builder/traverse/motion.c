/* SPDX-License-Identifier: Apache-2.0 */
/* motion.c - the matrices of motion instances at the time of a ray. */
#include "builder/traverse/motion.h"

#include "builder/format/srt.h"

bool motion_matrix(const struct portable_moving_instance *instance, float time, float ret_matrix[PORTABLE_MATRIX])
{
    const struct motion_weights at = motion_weights_at(time);
    float numbers[SRT_NUMBERS];
    if (instance->motion == MOTION_STATIC) {
        memcpy(ret_matrix, instance->start, PORTABLE_MATRIX * sizeof *ret_matrix);
        return true;
    }
    for (int i = 0; i < SRT_NUMBERS; i++)
        numbers[i] = motion_number(instance->start[i], instance->end[i], at);
    if (instance->motion == MOTION_SRT)
        return srt_matrix(numbers, ret_matrix);
    memcpy(ret_matrix, numbers, PORTABLE_MATRIX * sizeof *ret_matrix);
    return true;
}
