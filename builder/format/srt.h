/* SPDX-License-Identifier: Apache-2.0 */
/*
 * srt.h - the matrices of SRTs, by which motion instances move: a scale with a shear and a pivot, then a rotation by a
 * quaternion, then a translation. All functions may be called from any thread.
 */
#ifndef BVHD_SRT_H
#define BVHD_SRT_H

#include <stdbool.h>

/* The numbers of an SRT, in the order of VkSRTDataNV. */
enum {
    SRT_SX,
    SRT_A,
    SRT_B,
    SRT_PVX,
    SRT_SY,
    SRT_C,
    SRT_PVY,
    SRT_SZ,
    SRT_PVZ,
    SRT_QX,
    SRT_QY,
    SRT_QZ,
    SRT_QW,
    SRT_TX,
    SRT_TY,
    SRT_TZ,
    SRT_NUMBERS
};

/*
 * Composes the rotation by a quaternion x, y, z, w of length 1 with the scale of an SRT: the row-major 3x4 matrix of
 * the SRT without its translation.
 */
void srt_turn(const double quaternion[4], const float srt[SRT_NUMBERS], double ret_matrix[12]);

/*
 * Makes the row-major 3x4 matrix of an SRT. It is composed in double, with the quaternion divided by its length, and
 * rounded to float once. Returns false, with a matrix of zeros, if the quaternion is zero or not finite.
 */
bool srt_matrix(const float srt[SRT_NUMBERS], float ret_matrix[12]);

#endif
