/* SPDX-License-Identifier: Apache-2.0 */
/*
 * triangle_wide.h - the first half of triangle_intersect() with the three corners side by side in a register: whether the edge functions'
 * signs leave a hit possible. The same operations on the same numbers, so that what it rejects triangle_intersect() rejects.
 */
#ifndef BVHD_TRIANGLE_WIDE_H
#define BVHD_TRIANGLE_WIDE_H

#include "boxtest_kernels.h"
#include "triangle.h"

#ifdef BOXTEST_WIDE

/* corners[axis][0 .. 2], less the ray's origin */
BOXTEST_WIDE static inline __attribute__((always_inline)) __m256d triangle_wide_move(float corners[3][4],
                                                                                     const struct triangle_ray *ray, int axis)
{
    return _mm256_sub_pd(_mm256_cvtps_pd(_mm_load_ps(corners[axis])), _mm256_broadcast_sd(&ray->origin[axis]));
}

BOXTEST_WIDE static inline __attribute__((always_inline)) bool triangle_wide_may_hit(const struct triangle_ray *ray, const float *v0,
                                                                                     const float *v1, const float *v2)
{
    const __m128i xyz = _mm_setr_epi32(-1, -1, -1, 0);
    __m128 a = _mm_maskload_ps(v0, xyz), b = _mm_maskload_ps(v1, xyz), c = _mm_maskload_ps(v2, xyz);
    __m128 ab_xy = _mm_unpacklo_ps(a, b), ab_z = _mm_unpackhi_ps(a, b);
    _Alignas(16) float corners[3][4];
    _mm_store_ps(corners[0], _mm_shuffle_ps(ab_xy, c, _MM_SHUFFLE(3, 0, 1, 0)));
    _mm_store_ps(corners[1], _mm_shuffle_ps(ab_xy, c, _MM_SHUFFLE(3, 1, 3, 2)));
    _mm_store_ps(corners[2], _mm_shuffle_ps(ab_z, c, _MM_SHUFFLE(3, 2, 1, 0)));

    __m256d z = triangle_wide_move(corners, ray, ray->axis[2]);
    __m256d x = triangle_wide_move(corners, ray, ray->axis[0]), y = triangle_wide_move(corners, ray, ray->axis[1]);
    x = _mm256_sub_pd(x, _mm256_mul_pd(_mm256_broadcast_sd(&ray->shear[0]), z));
    y = _mm256_sub_pd(y, _mm256_mul_pd(_mm256_broadcast_sd(&ray->shear[1]), z));

    /* Lane k: the edge from corner k + 1 to corner k + 2. */
    __m256d from_x = _mm256_permute4x64_pd(x, _MM_SHUFFLE(3, 0, 2, 1)), to_x = _mm256_permute4x64_pd(x, _MM_SHUFFLE(3, 1, 0, 2));
    __m256d from_y = _mm256_permute4x64_pd(y, _MM_SHUFFLE(3, 0, 2, 1)), to_y = _mm256_permute4x64_pd(y, _MM_SHUFFLE(3, 1, 0, 2));
    __m256d edges = _mm256_sub_pd(_mm256_mul_pd(to_x, from_y), _mm256_mul_pd(to_y, from_x));
    int below = _mm256_movemask_pd(_mm256_cmp_pd(edges, _mm256_setzero_pd(), _CMP_LT_OQ)) & 7;
    int above = _mm256_movemask_pd(_mm256_cmp_pd(edges, _mm256_setzero_pd(), _CMP_GT_OQ)) & 7;
    return below == 0 || above == 0;
}

#endif
#endif
