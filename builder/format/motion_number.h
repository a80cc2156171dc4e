/* SPDX-License-Identifier: Apache-2.0 */
/*
 * motion_number.h - a number that moves, at a time.
 *
 * A number at time t is start * (1 - t) + end * t in float, each operation rounded once. It is the same for everybody
 * who computes it, so that triangles that share a vertex agree about its place. Rounding is monotone: of two numbers
 * that are in order at both keys, those at any time are in the same order or equal.
 */
#ifndef BVHD_MOTION_NUMBER_H
#define BVHD_MOTION_NUMBER_H

/* By how much the numbers at t = 0 and at t = 1 count. */
struct motion_weights {
    float start, end;
};

static inline struct motion_weights motion_weights_at(float time)
{
    return (struct motion_weights){1 - time, time};
}

static inline float motion_number(float start, float end, struct motion_weights at)
{
    return start * at.start + end * at.end;
}

#endif
