/* SPDX-License-Identifier: Apache-2.0 */
/*
 * boxtest_setup.h - boxtest_init_floats() as an inline function for the traversals that start with it, because the
 * set-up is the largest cost of a ray through a small structure.
 */
#ifndef BVHD_BOXTEST_SETUP_H
#define BVHD_BOXTEST_SETUP_H

#include "builder/traverse/boxtest_kernels.h"

#ifdef BOXTEST_AVX2

/* Returns the largest of the first three lanes, in these three. */
BOXTEST_AVX2_INLINE __m128 largest_float(__m128 vector)
{
    __m128 next = _mm_permute_ps(vector, _MM_SHUFFLE(3, 0, 2, 1)),
           last = _mm_permute_ps(vector, _MM_SHUFFLE(3, 1, 0, 2));
    return _mm_max_ps(_mm_max_ps(vector, next), last);
}

/* Returns the absolute values of the first three lanes, and 0. */
BOXTEST_AVX2_INLINE __m128 absolute_xyz(__m128 vector)
{
    return _mm_and_ps(vector, _mm_castsi128_ps(_mm_setr_epi32(INT32_MAX, INT32_MAX, INT32_MAX, 0)));
}

/* Returns the larger of two non-negative numbers, NaN being the largest. As integers they have that order. */
BOXTEST_AVX2_INLINE __m128 larger_size(__m128 a, __m128 b)
{
    return _mm_castsi128_ps(_mm_max_epi32(_mm_castps_si128(a), _mm_castps_si128(b)));
}

/* Returns the lanes that exceed the limit, as bits; the numbers are not negative. */
BOXTEST_AVX2_INLINE int lanes_beyond(__m128 vector, double limit)
{
    __m128i beyond = _mm_cmpgt_epi32(_mm_castps_si128(vector), _mm_castps_si128(_mm_set1_ps((float)limit)));
    return _mm_movemask_ps(_mm_castsi128_ps(beyond));
}

/* Overwrites the values that differ for rays that are parallel to an axis. */
BOXTEST_AVX2 static inline void setup_parallel(__m128 parallel, __m128 speeds, __m128 distance, __m128 t_reach,
                                               struct boxtest_ray *ray)
{
    float bound[4];
    __m128 moved = _mm_fmadd_ps(distance, _mm_set1_ps((float)corner_error), _mm_mul_ps(t_reach, speeds));
    _mm_storeu_ps(bound, _mm_fmadd_ps(moved, _mm_set1_ps(1.001f), _mm_set1_ps((float)underflow_error)));
    memcpy(ray->parallel_slack, bound, sizeof ray->parallel_slack);
    _mm_store_ps(ray->inverse, _mm_andnot_ps(parallel, _mm_load_ps(ray->inverse)));
    _mm_store_ps(ray->slack, _mm_blendv_ps(_mm_load_ps(ray->slack), _mm_set1_ps(FLT_MAX), parallel));
    _mm_store_ps(ray->common_slack, _mm_blendv_ps(_mm_load_ps(ray->common_slack), _mm_set1_ps(FLT_MAX), parallel));
}

/*
 * Implements boxtest_init_floats(). The factor 1.001 covers the rounding of the terms, of their sums and of the
 * constants; the last term covers underflow.
 */
BOXTEST_AVX2_INLINE bool setup_floats(__m128 origin, __m128 direction, float tmin, const float bounds[6],
                                      struct boxtest_ray *ret_ray)
{
    const __m128 one = _mm_set1_ps(1);
    __m128 d = _mm_blend_ps(direction, one, 8), speeds = absolute_xyz(d), speed = largest_float(speeds);
    __m128 min = _mm_loadu_ps(bounds), max = _mm_permute_ps(_mm_loadu_ps(bounds + 2), _MM_SHUFFLE(3, 3, 2, 1));
    __m128 corner = larger_size(absolute_xyz(min), absolute_xyz(max)),
           sizes = larger_size(absolute_xyz(origin), speeds);
    bool is_small = _mm_movemask_ps(_mm_cmpge_ps(corner, _mm_set1_ps((float)structure_min))) == 0;
    if (lanes_beyond(larger_size(sizes, corner), range_max) != 0 || is_small ||
        _mm_cvtss_f32(speed) < (float)direction_min)
        return false;

    __m128 inverse = _mm_div_ps(one, d), underflow = _mm_set1_ps((float)underflow_error);
    __m128 distance = _mm_max_ps(absolute_xyz(_mm_sub_ps(min, origin)), absolute_xyz(_mm_sub_ps(max, origin)));
    __m128 t_reach = _mm_mul_ps(largest_float(distance), _mm_div_ps(one, speed)),
           at_axis = _mm_mul_ps(distance, absolute_xyz(inverse));
    __m128 slack = _mm_fmadd_ps(t_reach, _mm_set1_ps((float)(1.001 * t_error)), underflow);
    __m128 wide = _mm_fmadd_ps(at_axis, _mm_set1_ps((float)(1.001 * (boxtest_gamma + corner_error))), slack);

    _mm_store_ps(ret_ray->origin, origin);
    _mm_store_ps(ret_ray->inverse, inverse);
    _mm_store_ps(ret_ray->slack, _mm_fmadd_ps(at_axis, _mm_set1_ps((float)(1.001 * corner_error)), slack));
    _mm_store_ps(ret_ray->common_slack, wide);
    _mm_store_ps(ret_ray->wide_scale, _mm_mul_ps(distance, _mm_set1_ps((float)wide_share)));
    ret_ray->backward = (unsigned)_mm_movemask_ps(d);
    ret_ray->planes = &boxtest_planes[ret_ray->backward];
    ret_ray->tmin = tmin;
    __m128 parallel = _mm_cmplt_ps(speeds, _mm_mul_ps(speed, _mm_set1_ps((float)parallel_ratio)));
    ret_ray->parallel_axes = (unsigned)_mm_movemask_ps(parallel) & 7;
    if (__builtin_expect(ret_ray->parallel_axes != 0, 0))
        setup_parallel(parallel, speeds, distance, t_reach, ret_ray);
    return true;
}

#endif
#endif
