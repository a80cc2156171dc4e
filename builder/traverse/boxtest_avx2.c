/* SPDX-License-Identifier: Apache-2.0 */
/*
 * boxtest_avx2.c - the functions of boxtest.h for machines with AVX2, FMA and BMI. The set-up is the largest cost of a
 * ray through a small structure.
 */
#include "builder/traverse/boxtest_setup.h"

#ifdef BOXTEST_AVX2

bool boxtest_has_avx2(void)
{
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
           __builtin_cpu_supports("bmi2") && __builtin_cpu_supports("popcnt");
}

BOXTEST_AVX2 unsigned boxtest_avx2(const struct boxtest_ray *ray, const struct portable_node *node, float tmax,
                                   float ret_near[8])
{
    return kernel_avx2(ray, node, tmax, ret_near);
}

BOXTEST_AVX2_INLINE __m256d absolute(__m256d vector)
{
    return _mm256_andnot_pd(_mm256_set1_pd(-0.0), vector);
}

/* Returns the largest lane, in all lanes. */
BOXTEST_AVX2_INLINE __m256d largest(__m256d vector)
{
    __m256d pairs = _mm256_max_pd(vector, _mm256_permute_pd(vector, 5));
    return _mm256_max_pd(pairs, _mm256_permute2f128_pd(pairs, pairs, 1));
}

/* Loads three floats and 0. */
BOXTEST_AVX2_INLINE __m256d load_floats(const float from[3])
{
    return _mm256_cvtps_pd(_mm_maskload_ps(from, _mm_setr_epi32(-1, -1, -1, 0)));
}

BOXTEST_AVX2_INLINE bool all_up_to(__m256d vector, double limit)
{
    return _mm256_movemask_pd(_mm256_cmp_pd(vector, _mm256_set1_pd(limit), _CMP_LE_OQ)) == 15;
}

/* Stores the sum of errors, rounded up, or FLT_MAX for parallel axes. */
BOXTEST_AVX2_INLINE void store_slack(__m256d error, __m256d parallel, float ret_slack[4])
{
    __m256d bound = _mm256_fmadd_pd(error, _mm256_set1_pd(1.001), _mm256_set1_pd(underflow_error));
    _mm_store_ps(ret_slack, _mm256_cvtpd_ps(_mm256_blendv_pd(bound, _mm256_set1_pd(FLT_MAX), parallel)));
}

BOXTEST_AVX2 static void store_parallel(__m256d moved, __m256d speeds, __m256d t_reach, struct boxtest_ray *ray)
{
    __m256d bound = _mm256_fmadd_pd(t_reach, speeds, moved);
    float slack[4];
    bound = _mm256_fmadd_pd(bound, _mm256_set1_pd(1.001), _mm256_set1_pd(underflow_error));
    _mm_storeu_ps(slack, _mm256_cvtpd_ps(bound));
    memcpy(ray->parallel_slack, slack, sizeof ray->parallel_slack);
}

BOXTEST_AVX2 bool boxtest_init_avx2(const double origin[3], const double direction[3], float tmin,
                                    const float bounds[6], struct boxtest_ray *ret_ray)
{
    __m256d o = _mm256_setr_pd(origin[0], origin[1], origin[2], 0),
            d = _mm256_setr_pd(direction[0], direction[1], direction[2], 0);
    __m256d min = load_floats(bounds), max = load_floats(bounds + 3), speeds = absolute(d);
    __m256d corner = _mm256_max_pd(absolute(min), absolute(max)), speed = largest(speeds);
    bool is_small = _mm256_movemask_pd(_mm256_cmp_pd(corner, _mm256_set1_pd(structure_min), _CMP_GE_OQ)) == 0;
    if (!all_up_to(absolute(o), range_max) || !all_up_to(speeds, range_max) || !all_up_to(corner, range_max) ||
        is_small || _mm256_cvtsd_f64(speed) < direction_min)
        return false;

    /* The fourth lane of the quotients is 1 / speed. */
    __m256d one = _mm256_set1_pd(1);
    __m256d parallel = _mm256_cmp_pd(speeds, _mm256_mul_pd(speed, _mm256_set1_pd(parallel_ratio)), _CMP_LT_OQ);
    __m256d quotients = _mm256_div_pd(one, _mm256_blend_pd(_mm256_blendv_pd(d, one, parallel), speed, 8));
    __m256d inverse = _mm256_andnot_pd(parallel, quotients), size = absolute(inverse);

    __m256d distance = _mm256_max_pd(absolute(_mm256_sub_pd(min, o)), absolute(_mm256_sub_pd(max, o)));
    __m256d t_reach = _mm256_mul_pd(largest(distance), _mm256_permute4x64_pd(quotients, 0xff));
    __m128 rounded = _mm256_cvtpd_ps(o);
    __m256d moved = absolute(_mm256_sub_pd(o, _mm256_cvtps_pd(rounded)));
    moved = _mm256_fmadd_pd(distance, _mm256_set1_pd(corner_error), moved);
    __m256d slack = _mm256_fmadd_pd(moved, size, _mm256_mul_pd(t_reach, _mm256_set1_pd(t_error)));
    __m256d wide = _mm256_fmadd_pd(_mm256_mul_pd(distance, _mm256_set1_pd(boxtest_gamma)), size, slack);

    _mm_store_ps(ret_ray->origin, rounded);
    _mm_store_ps(ret_ray->inverse, _mm256_cvtpd_ps(inverse));
    store_slack(slack, parallel, ret_ray->slack);
    store_slack(wide, parallel, ret_ray->common_slack);
    _mm_store_ps(ret_ray->wide_scale, _mm256_cvtpd_ps(_mm256_mul_pd(distance, _mm256_set1_pd(wide_share))));
    ret_ray->backward = (unsigned)_mm256_movemask_pd(d);
    ret_ray->planes = &boxtest_planes[ret_ray->backward];
    ret_ray->tmin = tmin;
    ret_ray->parallel_axes = (unsigned)_mm256_movemask_pd(parallel) & 7;
    if (ret_ray->parallel_axes)
        store_parallel(moved, speeds, t_reach, ret_ray);
    return true;
}

BOXTEST_AVX2 bool boxtest_init_floats(const float *origin, const float *direction, float tmin, const float bounds[6],
                                      struct boxtest_ray *ret_ray)
{
    return setup_floats(_mm_loadu_ps(origin), _mm_loadu_ps(direction), tmin, bounds, ret_ray);
}

#else

bool boxtest_has_avx2(void)
{
    return false;
}

bool boxtest_init_avx2(const double origin[3], const double direction[3], float tmin, const float bounds[6],
                       struct boxtest_ray *ret_ray)
{
    return boxtest_init(origin, direction, tmin, bounds, ret_ray);
}

bool boxtest_init_floats(const float *origin, const float *direction, float tmin, const float bounds[6],
                         struct boxtest_ray *ret_ray)
{
    const double o[3] = {origin[0], origin[1], origin[2]}, d[3] = {direction[0], direction[1], direction[2]};
    return boxtest_init(o, d, tmin, bounds, ret_ray);
}

unsigned boxtest_avx2(const struct boxtest_ray *ray, const struct portable_node *node, float tmax, float ret_near[8])
{
    return boxtest_float(ray, node, tmax, ret_near);
}

#endif
