/* SPDX-License-Identifier: Apache-2.0 */
/*
 * motion.h - where things that move are at a time in [0, 1], from 0, the start, to 1, the end. Everything that reads or
 * bounds what moves computes it in these ways, so that all agree to the bit.
 *
 * All functions may be called from any thread.
 */
#ifndef BVHD_MOTION_H
#define BVHD_MOTION_H

#include <stdbool.h>
#include <stdint.h>

/*
 * Returns a number at a time, such as a coordinate of a vertex: in float, and each operation rounded once. It is within
 * 2^-22 of the greater magnitude of the two outside of the interval between them, and within 2^-147 where that is tiny.
 */
static inline float motion_number(float start, float end, float time)
{
    return start * (1 - time) + end * time;
}

/*
 * The numbers of an SRT, in the order of VkSRTDataNV: a scale with a shear and a pivot, a rotation as a quaternion, and
 * a translation.
 */
enum {
    MOTION_SX,
    MOTION_A,
    MOTION_B,
    MOTION_PVX,
    MOTION_SY,
    MOTION_C,
    MOTION_PVY,
    MOTION_SZ,
    MOTION_PVZ,
    MOTION_QX,
    MOTION_QY,
    MOTION_QZ,
    MOTION_QW,
    MOTION_TX,
    MOTION_TY,
    MOTION_TZ,
    MOTION_SRT_NUMBERS
};

/*
 * Composes the rotation by a quaternion x, y, z, w of length 1 with the scale of an SRT: the row-major 3x4 matrix of
 * the SRT without its translation.
 */
void motion_turn(const double quaternion[4], const float srt[MOTION_SRT_NUMBERS], double ret_matrix[12]);

/*
 * Makes the row-major 3x4 matrix of an SRT. It is composed in double, with the quaternion divided by its length, and
 * rounded to float once. Returns false, with a matrix of zeros, for a quaternion of zeros.
 */
bool motion_srt_matrix(const float srt[MOTION_SRT_NUMBERS], float ret_matrix[12]);

/*
 * Makes the matrix of a motion instance of a MOTION_ type at a time. Of MOTION_STATIC and MOTION_MATRIX `start` and
 * `end` hold 12 numbers, of MOTION_SRT 16; a static instance has the matrix `start` at all times. Returns false where
 * the instance is not at that time; the matrix may be singular, too.
 */
bool motion_matrix(uint32_t type, const float *start, const float *end, float time, float ret_matrix[12]);

#endif
