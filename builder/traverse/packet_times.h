/* SPDX-License-Identifier: Apache-2.0 */
/*
 * packet_times.h - what packets do differently where the rays through motion triangles have different times: planes and
 * corners are computed for each lane at its own time. Internal to packet_avx2.c.
 *
 * A plane relative to a corner c of the bundle's origins is (p - c) + (p' - p) * t, whose product and sum are one fused
 * operation. With the terms of packet_setup.h and boxtest_moving.h, p' - p and p - c are off by u of themselves, which
 * is at most 2u M and 2u M more than u of the plane's own distance from c: within the 8u M of the slack, of which
 * vertices take the rest. The sum is rounded once more, by u of that distance, so that a distance is off by 4u of
 * itself and 4u |(o - c) * inverse|: the slack gets 8u of the latter here.
 *
 * For a given plane all of this is monotone in t, so that the planes of all lanes are between those at the least and at
 * the greatest time, which the test of the bundle uses.
 */
#ifndef BVHD_PACKET_TIMES_H
#define BVHD_PACKET_TIMES_H

#include "builder/traverse/packet_setup.h"

#ifdef BOXTEST_AVX2

/* Takes the times of the rays. Returns whether they differ. */
BOXTEST_AVX2_INLINE bool times_init(struct packet_times *times, const struct ray *const rays[LANES])
{
    float at[LANES];
    for (int lane = 0; lane < LANES; lane++)
        at[lane] = rays[lane]->time;
    times->end = _mm256_loadu_ps(at);
    times->start = _mm256_sub_ps(_mm256_set1_ps(1), times->end);
    times->least = least_lane(times->end);
    times->greatest = greatest_lane(times->end);
    return times->least != times->greatest;
}

/* Widens the slack of a packet, after the bundle, by what planes of different times are off more. */
BOXTEST_AVX2_INLINE void times_widen(struct packet *packet, uint32_t lanes)
{
    __m256 moved = _mm256_setzero_ps();
    for (int axis = 0; axis < 3; axis++)
        moved = _mm256_max_ps(
            moved, _mm256_max_ps(absolute_lanes(packet->near_moved[axis]), absolute_lanes(packet->far_moved[axis])));
    packet->slack = _mm256_fmadd_ps(moved, _mm256_set1_ps(0x1p-22f), packet->slack);
    packet->bundle_slack = greatest_lane(_mm256_blendv_ps(_mm256_set1_ps(-INFINITY), packet->slack, lane_mask(lanes)));
}

/* The planes of both ends of the times, each times both ends of the reciprocals. */
struct times_products {
    __m256 least, greatest;
};

BOXTEST_AVX2_INLINE struct times_products times_multiply(const struct packet_times *times, __m256 start, __m256 moved,
                                                         __m256 least, __m256 greatest)
{
    const __m256 early = _mm256_fmadd_ps(moved, _mm256_broadcast_ss(&times->least), start),
                 late = _mm256_fmadd_ps(moved, _mm256_broadcast_ss(&times->greatest), start);
    const __m256 a = _mm256_mul_ps(early, least), b = _mm256_mul_ps(early, greatest), c = _mm256_mul_ps(late, least),
                 d = _mm256_mul_ps(late, greatest);
    return (struct times_products){_mm256_min_ps(_mm256_min_ps(a, b), _mm256_min_ps(c, d)),
                                   _mm256_max_ps(_mm256_max_ps(a, b), _mm256_max_ps(c, d))};
}

/* Returns a plane of a child for each lane. */
BOXTEST_AVX2_INLINE __m256 times_plane(const struct packet_times *times, const float *start, const float *moved)
{
    return _mm256_fmadd_ps(_mm256_broadcast_ss(moved), times->end, _mm256_broadcast_ss(start));
}

/* The corners of a triangle for each of four lanes. */
struct times_corners {
    float at[3][3][4]; /* corner, axis, lane */
};

/* Does for four lanes what moving_corner_at() does for one ray. */
BOXTEST_AVX2_INLINE void times_corners_init(const struct packet_times *times, int half,
                                            const struct unpacked_moving_triangle *triangle,
                                            struct times_corners *ret_corners)
{
    const __m128 start = half ? _mm256_extractf128_ps(times->start, 1) : _mm256_castps256_ps128(times->start),
                 end = half ? _mm256_extractf128_ps(times->end, 1) : _mm256_castps256_ps128(times->end);
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 3; axis++)
            _mm_storeu_ps(ret_corners->at[k][axis],
                          _mm_add_ps(_mm_mul_ps(_mm_broadcast_ss(&triangle->start[k][axis]), start),
                                     _mm_mul_ps(_mm_broadcast_ss(&triangle->end[k][axis]), end)));
}

/* Gives the corners of one of the four lanes. */
static inline void times_corners_of(const struct times_corners *corners, unsigned lane, float ret_corners[3][4])
{
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 3; axis++)
            ret_corners[k][axis] = corners->at[k][axis][lane];
}

#endif
#endif
