/* SPDX-License-Identifier: Apache-2.0 */
/*
 * triangle_avx2.h - triangle_intersect() with the three corners side by side in a register. It does the same operations
 * on the same numbers, so that the answers are the same to the last bit; triangles that have to be decided exactly are
 * passed to triangle_intersect().
 */
#ifndef BVHD_TRIANGLE_AVX2_H
#define BVHD_TRIANGLE_AVX2_H

#include "builder/traverse/boxtest_kernels.h"
#include "builder/traverse/triangle.h"

#ifdef BOXTEST_AVX2

/* A triangle_ray with each number in all lanes. */
struct triangle_avx2_ray {
    __m256d origin[3], shear[3];
    __m128i order; /* the axis of each component */
};

/* Copies each number of a prepared ray to all lanes. */
BOXTEST_AVX2_INLINE void triangle_avx2_spread(const struct triangle_ray *ray, struct triangle_avx2_ray *ret_ray)
{
    for (int k = 0; k < 3; k++) {
        ret_ray->origin[k] = _mm256_broadcast_sd(&ray->origin[k]);
        ret_ray->shear[k] = _mm256_broadcast_sd(&ray->shear[k]);
    }
    ret_ray->order = _mm_loadu_si128((const __m128i *)(const void *)ray->axis);
}

/* Three values, one for each corner or each edge; the fourth lane is unused. */
struct triangle_lanes {
    __m256d x, y, z;
};

BOXTEST_AVX2_INLINE __m256d triangle_avx2_move(__m128 along_axis, __m256d origin)
{
    return _mm256_sub_pd(_mm256_cvtps_pd(along_axis), origin);
}

/* Returns the corners in the ray's space. */
BOXTEST_AVX2_INLINE struct triangle_lanes triangle_avx2_corners(const struct triangle_avx2_ray *ray, __m128 v0,
                                                                __m128 v1, __m128 v2)
{
    __m128 a = _mm_permutevar_ps(v0, ray->order), b = _mm_permutevar_ps(v1, ray->order);
    __m128 c = _mm_permutevar_ps(v2, ray->order), ab_xy = _mm_unpacklo_ps(a, b), ab_z = _mm_unpackhi_ps(a, b);
    __m256d z = triangle_avx2_move(_mm_shuffle_ps(ab_z, c, _MM_SHUFFLE(2, 2, 1, 0)), ray->origin[2]);
    __m256d x = triangle_avx2_move(_mm_shuffle_ps(ab_xy, c, _MM_SHUFFLE(0, 0, 1, 0)), ray->origin[0]);
    __m256d y = triangle_avx2_move(_mm_shuffle_ps(ab_xy, c, _MM_SHUFFLE(1, 1, 3, 2)), ray->origin[1]);
    return (struct triangle_lanes){_mm256_sub_pd(x, _mm256_mul_pd(ray->shear[0], z)),
                                   _mm256_sub_pd(y, _mm256_mul_pd(ray->shear[1], z)), _mm256_mul_pd(ray->shear[2], z)};
}

/*
 * Does the work of triangle_ray_init() for a ray that is known in float, with the same quotients and products; the
 * fourth lanes are unused.
 */
BOXTEST_AVX2_INLINE void triangle_avx2_init(__m128 origin, __m128 direction, struct triangle_ray *ret_ray,
                                            struct triangle_avx2_ray *ret_wide)
{
    __m128 size = _mm_andnot_ps(_mm_set1_ps(-0.0f), direction);
    __m128 next = _mm_permute_ps(size, _MM_SHUFFLE(3, 0, 2, 1)), last = _mm_permute_ps(size, _MM_SHUFFLE(3, 1, 0, 2));
    int is_longest = _mm_movemask_ps(_mm_cmpge_ps(size, _mm_max_ps(next, last))) | 4;
    int longest = __builtin_ctz((unsigned)is_longest), is_backward = _mm_movemask_ps(direction) >> longest & 1;
    __m128i order = _mm_loadu_si128((const __m128i *)(const void *)triangle_axis_orders[is_backward][longest]);
    __m256d towards = _mm256_cvtps_pd(_mm_permutevar_ps(direction, order)),
            from = _mm256_cvtps_pd(_mm_permutevar_ps(origin, order));
    __m256d inverse = _mm256_broadcastsd_pd(_mm_div_sd(_mm_set_sd(1), _mm256_extractf128_pd(towards, 1)));
    __m256d shear = _mm256_mul_pd(towards, inverse);
    _mm256_storeu_pd(ret_ray->origin, from);
    _mm256_storeu_pd(ret_ray->shear, _mm256_blend_pd(shear, inverse, 4));
    _mm_storeu_si128((__m128i *)(void *)ret_ray->axis, order);
    *ret_wide = (struct triangle_avx2_ray){
        {_mm256_permute4x64_pd(from, 0), _mm256_permute4x64_pd(from, 0x55), _mm256_permute4x64_pd(from, 0xaa)},
        {_mm256_permute4x64_pd(shear, 0), _mm256_permute4x64_pd(shear, 0x55), inverse},
        order};
}

/* Returns the sum of three lanes, added in their order. */
BOXTEST_AVX2_INLINE double triangle_avx2_sum(__m256d lanes)
{
    __m128d low = _mm256_castpd256_pd128(lanes), high = _mm256_extractf128_pd(lanes, 1);
    return _mm_cvtsd_f64(_mm_add_sd(_mm_add_sd(low, _mm_unpackhi_pd(low, low)), high));
}

/* Decides a triangle exactly whose corners are in registers. */
BOXTEST_AVX2 __attribute__((noinline, unused)) static bool triangle_avx2_decide(const struct triangle_ray *ray,
                                                                                const __m128 vertices[3],
                                                                                struct triangle_hit *ret_hit)
{
    float corners[3][4];
    for (int k = 0; k < 3; k++)
        _mm_storeu_ps(corners[k], vertices[k]);
    return triangle_intersect(ray, corners[0], corners[1], corners[2], ret_hit);
}

/*
 * Works like triangle_intersect(), with corners that are loaded; the fourth lanes are unused. `wide` and `ray` are the
 * same ray in two forms; `ray` is for triangles that have to be decided exactly. These are read from `vertices` unless
 * that is NULL.
 */
BOXTEST_AVX2_INLINE bool triangle_avx2_intersect_loaded(const struct triangle_avx2_ray *wide,
                                                        const struct triangle_ray *ray, const __m128 loaded[3],
                                                        const float *const *vertices, struct triangle_hit *ret_hit)
{
    struct triangle_lanes corners = triangle_avx2_corners(wide, loaded[0], loaded[1], loaded[2]);
    /* Lane k holds the edge from corner k + 1 to corner k + 2. */
    __m256d from_x = _mm256_permute4x64_pd(corners.x, _MM_SHUFFLE(3, 0, 2, 1));
    __m256d from_y = _mm256_permute4x64_pd(corners.y, _MM_SHUFFLE(3, 0, 2, 1));
    __m256d to_x = _mm256_permute4x64_pd(corners.x, _MM_SHUFFLE(3, 1, 0, 2));
    __m256d to_y = _mm256_permute4x64_pd(corners.y, _MM_SHUFFLE(3, 1, 0, 2));
    __m256d left = _mm256_mul_pd(to_x, from_y), right = _mm256_mul_pd(to_y, from_x);
    /* The signs of left - right; both bits are 0 where it is 0. */
    int below = _mm256_movemask_pd(_mm256_cmp_pd(left, right, _CMP_LT_OQ)) & 7;
    int above = _mm256_movemask_pd(_mm256_cmp_pd(left, right, _CMP_GT_OQ)) & 7;
    if (((below + 7) & (above + 7) & 8) != 0) /* neither is 0; two branches would be harder to predict */
        return false;

    const __m256d sign = _mm256_set1_pd(-0.0);
    __m256d edges = _mm256_sub_pd(left, right);
    double sum = triangle_avx2_sum(edges);
    double products = triangle_avx2_sum(_mm256_add_pd(_mm256_andnot_pd(sign, left), _mm256_andnot_pd(sign, right)));
    /* The threshold is twice that of is_cancelled(), because this sum may be rounded differently. */
    bool is_clear = (below | above) == 7 && fabs(sum) >= 2 * triangle_cancellation * products && fabs(sum) <= DBL_MAX;
    if (__builtin_expect(!is_clear, 0))
        return vertices ? triangle_intersect(ray, vertices[0], vertices[1], vertices[2], ret_hit)
                        : triangle_avx2_decide(ray, loaded, ret_hit);

    __m256d weights = _mm256_div_pd(edges, _mm256_set1_pd(sum));
    __m128d u = _mm256_castpd256_pd128(weights);
    ret_hit->t = triangle_avx2_sum(_mm256_mul_pd(weights, corners.z));
    ret_hit->u = _mm_cvtsd_f64(_mm_unpackhi_pd(u, u));
    ret_hit->v = _mm_cvtsd_f64(_mm256_extractf128_pd(weights, 1));
    ret_hit->front = sum > 0;
    return true;
}

/*
 * Does the same with corners in memory. It reads 16 bytes of each vertex, which is safe because at least one geometry
 * follows the last vertex of a structure with triangles.
 */
BOXTEST_AVX2_INLINE bool triangle_avx2_intersect(const struct triangle_avx2_ray *wide, const struct triangle_ray *ray,
                                                 const float *const vertices[3], struct triangle_hit *ret_hit)
{
    const __m128 loaded[3] = {_mm_loadu_ps(vertices[0]), _mm_loadu_ps(vertices[1]), _mm_loadu_ps(vertices[2])};
    return triangle_avx2_intersect_loaded(wide, ray, loaded, vertices, ret_hit);
}

#endif
#endif
