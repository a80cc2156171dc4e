/* SPDX-License-Identifier: Apache-2.0 */
/*
 * boxtest_kernels.h - the inner part of boxtest.h, which is compiled into the loops that use it: in plain C, in double,
 * and with AVX2.
 *
 * Comparisons are written so that a NaN, which only a node that no writer makes can cause, is a miss.
 */
#ifndef BVHD_BOXTEST_KERNELS_H
#define BVHD_BOXTEST_KERNELS_H

#include <float.h>
#include <math.h>

#include "builder/traverse/boxtest.h"

#if defined(__x86_64__) && defined(__GNUC__)
#include <immintrin.h>
#define BOXTEST_AVX2 __attribute__((target("avx2,fma,bmi,bmi2,popcnt")))
#endif

#define BOXTEST_INLINE static inline __attribute__((always_inline))

/*
 * The ranges of rays and structures in which float suffices: origins, directions and bounds are at most range_max, the
 * largest of the bounds is at least structure_min, and the longest component of the direction at least direction_min.
 */
static const double range_max = 0x1p60, structure_min = 0x1p-60, direction_min = 0x1p-32;
/*
 * An axis whose direction is less than this share of the longest counts as parallel: float's rounding of the position
 * is of that size.
 */
static const double parallel_ratio = 0x1p-30;
/*
 * Terms of the slack in boxtest.h: how far the triangle test moves corners, relative to their distance; the allowance
 * for t, relative to the largest |t| in the structure; and the allowance for underflow.
 */
static const double corner_error = 0x1p-50, t_error = 0x1p-40, underflow_error = 0x1p-118;
/*
 * A node is 256 steps (its scale) wide. If the step is at least this share of the distance R of boxtest.h, the common
 * bound, 8u of the distance with u = 2^-24, is at most 1/64 of the node.
 */
static const double wide_share = 0x1p-23;

/*
 * The planes that a ray meets first and last, indexed by the signs of its direction: bit a is set if it is negative
 * along axis a.
 */
extern const struct boxtest_planes boxtest_planes[8];

/* The factors of the error bounds: 8u with u = 2^-24 in float, 16u with u = 2^-53 in double. */
static const float boxtest_gamma = 0x1p-21f;
static const double boxtest_gamma_double = 0x1p-49;

/* Returns 2^(exponent - 127), or 0 for exponent 0, by building the bits of a float. */
BOXTEST_INLINE float boxtest_scale(uint8_t exponent)
{
    uint32_t bits = (uint32_t)exponent << 23;
    float scale;
    memcpy(&scale, &bits, sizeof scale);
    return scale;
}

BOXTEST_INLINE float greater(float a, float b)
{
    return a > b ? a : b;
}

BOXTEST_INLINE float lesser(float a, float b)
{
    return a < b ? a : b;
}

/*
 * Where a ray meets the planes of a node's grid: plane q along an axis between q * step + lo and q * step + hi. The
 * planes that it meets first and last are the eight bytes at near and far.
 */
struct grid_steps {
    float lo[3], hi[3], step[3];
    const uint8_t *near[3], *far[3];
};

BOXTEST_INLINE struct grid_steps grid_steps_of(const struct boxtest_ray *ray, const struct portable_node *node)
{
    struct grid_steps grid;
    for (int axis = 0; axis < 3; axis++) {
        float offset = (node->origin[axis] - ray->origin[axis]) * ray->inverse[axis];
        grid.step[axis] = boxtest_scale(node->exponent[axis]) * ray->inverse[axis];
        float error = boxtest_gamma * (fabsf(offset) + 255.0f * fabsf(grid.step[axis])) + ray->slack[axis];
        grid.lo[axis] = offset - error;
        grid.hi[axis] = offset + error;
        grid.near[axis] = (const uint8_t *)node + ray->planes->near[axis];
        grid.far[axis] = (const uint8_t *)node + ray->planes->far[axis];
    }
    return grid;
}

/* Implements boxtest_float(). */
BOXTEST_INLINE unsigned kernel_float(const struct boxtest_ray *ray, const struct portable_node *node, float tmax,
                                     float ret_near[8])
{
    const struct grid_steps grid = grid_steps_of(ray, node);
    const float *lo = grid.lo, *hi = grid.hi, *step = grid.step;
    unsigned hits = 0;
    for (unsigned s = 0; s < 8; s++) {
        float near =
            greater(greater((float)grid.near[0][s] * step[0] + lo[0], (float)grid.near[1][s] * step[1] + lo[1]),
                    greater((float)grid.near[2][s] * step[2] + lo[2], ray->tmin));
        float far = lesser(lesser((float)grid.far[0][s] * step[0] + hi[0], (float)grid.far[1][s] * step[1] + hi[1]),
                           lesser((float)grid.far[2][s] * step[2] + hi[2], tmax));
        hits |= (unsigned)(near <= far && node->meta[s] != 0) << s;
        ret_near[s] = near;
    }
    return ray->parallel_axes ? boxtest_beside(ray, node, hits) : hits;
}

/*
 * Returns whether a box reaches the ray's position on an axis to which the ray is exactly parallel. The box lies
 * between offset + lo and offset + hi, relative to the ray's origin; `moved` is by how much its planes may be off.
 */
BOXTEST_INLINE bool is_beside(double offset, double lo, double hi, double moved)
{
    double slack = boxtest_gamma_double * (fabs(offset) + fabs(lo) + fabs(hi)) + moved;
    return offset + lo <= slack && offset + hi >= -slack;
}

/*
 * Narrows near .. far to what a ray has of a box along one axis, whose planes are at offset + lo and offset + hi from
 * its origin. Returns false if the ray is parallel and beside it.
 */
BOXTEST_INLINE bool narrow_double(const struct boxtest_exact *ray, int axis, double offset, double lo, double hi,
                                  double *near, double *far)
{
    if (ray->parallel_axes >> axis & 1)
        return is_beside(offset, lo, hi, ray->parallel_slack[axis]);
    const double inverse = ray->inverse[axis];
    const double first = (offset + (inverse < 0 ? hi : lo)) * inverse,
                 last = (offset + (inverse < 0 ? lo : hi)) * inverse;
    const double error = boxtest_gamma_double * ((fabs(offset) + fabs(hi)) * fabs(inverse)) + ray->slack[axis];
    *near = fmax(*near, first - error);
    *far = fmin(*far, last + error);
    return true;
}

/* Implements boxtest_double(). */
BOXTEST_INLINE unsigned kernel_double(const struct boxtest_exact *ray, const struct portable_node *node, double tmax,
                                      double ret_near[8])
{
    unsigned hits = 0;
    for (unsigned s = 0; s < 8; s++) {
        double near = ray->tmin, far = tmax;
        bool reaches = node->meta[s] != 0;
        for (int axis = 0; axis < 3; axis++) {
            double offset = node->origin[axis] - ray->origin[axis], scale = boxtest_scale(node->exponent[axis]);
            double lo = node->lo[axis][s] * scale, hi = node->hi[axis][s] * scale;
            reaches = narrow_double(ray, axis, offset, lo, hi, &near, &far) && reaches;
        }
        hits |= (unsigned)(reaches && near <= far) << s;
        ret_near[s] = near;
    }
    return hits;
}

BOXTEST_INLINE double greater_double(double a, double b)
{
    return a > b ? a : b;
}

BOXTEST_INLINE double lesser_double(double a, double b)
{
    return a < b ? a : b;
}

/*
 * Tests one box of floats, from a node with two children. Its planes are moved, divided and compared in double, which
 * rounds their distances three times by at most 2^-53 each. Empty and NaN boxes are never met.
 */
BOXTEST_INLINE bool kernel_box(const struct boxtest_exact *ray, const float min[3], const float max[3], double tmax,
                               double *ret_near)
{
    double near = ray->tmin, far = tmax;
    for (int axis = 0; axis < 3; axis++) {
        if (!(min[axis] <= max[axis]))
            return false;
        double lo = min[axis] - ray->origin[axis], hi = max[axis] - ray->origin[axis], inverse = ray->inverse[axis];
        if (ray->parallel_axes >> axis & 1) {
            if (!is_beside(0, lo, hi, ray->parallel_slack[axis]))
                return false;
            continue;
        }
        double first = (inverse < 0 ? hi : lo) * inverse, last = (inverse < 0 ? lo : hi) * inverse;
        double error = boxtest_gamma_double * (fabs(first) + fabs(last)) + ray->slack[axis];
        near = greater_double(first - error, near);
        far = lesser_double(last + error, far);
    }
    *ret_near = near;
    return near <= far;
}

#ifdef BOXTEST_AVX2

#define BOXTEST_AVX2_INLINE BOXTEST_AVX2 static inline __attribute__((always_inline))

/* Loads eight quantised planes as floats. */
BOXTEST_AVX2_INLINE __m256 load_planes(const struct portable_node *node, uint32_t at)
{
    return _mm256_cvtepi32_ps(
        _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)(const void *)((const char *)node + at))));
}

/* The planes of a node's children that a ray meets first and last, along each axis. */
struct spans {
    __m256i near[3], far[3];
};

/*
 * Computes each child's interval along one axis, from its planes in steps of the grid; every lane of `exponents` holds
 * the node's exponents.
 */
BOXTEST_AVX2_INLINE void span_avx2(const struct boxtest_ray *ray, const struct portable_node *node, int axis,
                                   __m256i exponents, __m256 near, __m256 far, struct spans *spans)
{
    __m256 offset = _mm256_sub_ps(_mm256_broadcast_ss(&node->origin[axis]), _mm256_broadcast_ss(&ray->origin[axis]));
    __m256 inverse = _mm256_broadcast_ss(&ray->inverse[axis]), slack = _mm256_broadcast_ss(&ray->common_slack[axis]);
    __m256 lo = _mm256_fmsub_ps(offset, inverse, slack), hi = _mm256_fmadd_ps(offset, inverse, slack);
    __m256i scale = _mm256_and_si256(_mm256_slli_epi32(exponents, 23 - 8 * axis), _mm256_set1_epi32(0xff << 23));
    __m256 steps = _mm256_mul_ps(_mm256_castsi256_ps(scale), inverse);
    spans->near[axis] = _mm256_castps_si256(_mm256_fmadd_ps(near, steps, lo));
    spans->far[axis] = _mm256_castps_si256(_mm256_fmadd_ps(far, steps, hi));
}

/*
 * Returns the children of which the ray has something along all axes, and where its intervals in their boxes begin and
 * end. Distances are compared as integers, which is faster: floats have the same order as integers unless both are
 * negative. Of two negative floats the larger integer is the lesser float, so that intervals never become shorter.
 */
BOXTEST_AVX2_INLINE unsigned join_spans(const struct boxtest_ray *ray, const struct spans *spans, float tmax,
                                        __m256 *ret_first, __m256 *ret_last)
{
    const __m256i *near = spans->near, *far = spans->far;
    const __m256i first = _mm256_max_epi32(_mm256_max_epi32(near[0], near[1]),
                                           _mm256_max_epi32(near[2], _mm256_castps_si256(_mm256_set1_ps(ray->tmin))));
    const __m256i last = _mm256_min_epi32(_mm256_min_epi32(far[0], far[1]),
                                          _mm256_min_epi32(far[2], _mm256_castps_si256(_mm256_set1_ps(tmax))));
    *ret_first = _mm256_castsi256_ps(first);
    *ret_last = _mm256_castsi256_ps(last);
    return (unsigned)_mm256_movemask_ps(_mm256_cmp_ps(*ret_first, *ret_last, _CMP_LE_OQ));
}

/* Does the same; ret_near are where the intervals begin. */
BOXTEST_AVX2_INLINE unsigned meet_spans(const struct boxtest_ray *ray, const struct spans *spans, float tmax,
                                        float ret_near[8])
{
    __m256 first, last;
    const unsigned hits = join_spans(ray, spans, tmax, &first, &last);
    _mm256_storeu_ps(ret_near, first);
    return hits;
}

/* Returns whether a step of a node with these exponents is too small for the bound that is common to all nodes. */
BOXTEST_AVX2_INLINE bool is_fine(const struct boxtest_ray *ray, int exponents)
{
    const __m128 scale = _mm_castsi128_ps(_mm_slli_epi32(_mm_cvtepu8_epi32(_mm_cvtsi32_si128(exponents)), 23));
    const __m128 is_small =
        _mm_and_ps(_mm_cmplt_ps(scale, _mm_load_ps(ray->wide_scale)), _mm_cmpgt_ps(scale, _mm_setzero_ps()));
    return _mm_movemask_ps(is_small) != 0;
}

/* Removes empty slots from `hits`. */
BOXTEST_AVX2_INLINE unsigned without_empty(const struct portable_node *node, unsigned hits)
{
    const __m128i meta = _mm_loadl_epi64((const __m128i *)(const void *)node->meta);
    return hits & ~(unsigned)_mm_movemask_epi8(_mm_cmpeq_epi8(meta, _mm_setzero_si128()));
}

/* Works like boxtest_avx2(), but the result can contain empty slots, and it ignores parallel axes. */
BOXTEST_AVX2_INLINE unsigned kernel_avx2_slots(const struct boxtest_ray *ray, const struct portable_node *node,
                                               float tmax, float ret_near[8])
{
    const int exponents = (int)bytes_get32(node->exponent); /* the fourth lane holds the inner mask, which is unused */
    if (__builtin_expect(is_fine(ray, exponents), 0))
        return boxtest_float(ray, node, tmax, ret_near);
    const __m256i all = _mm256_set1_epi32(exponents);
    struct spans spans;
    for (int axis = 0; axis < 3; axis++)
        span_avx2(ray, node, axis, all, load_planes(node, ray->planes->near[axis]),
                  load_planes(node, ray->planes->far[axis]), &spans);
    return meet_spans(ray, &spans, tmax, ret_near);
}

/*
 * A ray for tests of unpacked nodes: the reciprocals of its direction, made smaller and larger by more than the error
 * of a distance; and where in a node the planes are at which it enters and leaves boxes, so that no test branches on
 * the signs of the direction, which differ from ray to ray.
 */
struct boxtest_scales {
    _Alignas(16) float inner[4], outer[4];
    _Alignas(16) uint32_t near_at[4], far_at[4]; /* offsets in bytes */
};

/* Returns the reciprocals for a ray's tests of unpacked nodes. */
BOXTEST_AVX2_INLINE struct boxtest_scales unpacked_scales(const struct boxtest_ray *ray)
{
    enum { ROW = sizeof(((struct unpacked_node *)NULL)->planes[0]) };
    struct boxtest_scales scales;
    const __m128 inverse = _mm_load_ps(ray->inverse);
    _mm_store_ps(scales.inner, _mm_mul_ps(inverse, _mm_set1_ps(1 - boxtest_gamma)));
    _mm_store_ps(scales.outer, _mm_mul_ps(inverse, _mm_set1_ps(1 + boxtest_gamma)));
    const __m128i least = _mm_setr_epi32(0, ROW, 2 * ROW, 0), beyond = _mm_set1_epi32(3 * ROW);
    const __m128i back = _mm_and_si128(_mm_srai_epi32(_mm_castps_si128(inverse), 31), beyond);
    _mm_store_si128((__m128i *)(void *)scales.near_at, _mm_add_epi32(least, back));
    _mm_store_si128((__m128i *)(void *)scales.far_at, _mm_add_epi32(least, _mm_sub_epi32(beyond, back)));
    return scales;
}

BOXTEST_AVX2_INLINE __m256 unpacked_planes_at(const struct unpacked_node *node, uint32_t offset)
{
    return _mm256_loadu_ps((const float *)(const void *)((const char *)node + offset));
}

/*
 * Tests the eight children of an unpacked node; the intervals in which the ray is in their boxes are bounded by
 * *ret_first and *ret_last. Empty slots are never met; parallel axes are ignored. The ray's tmin is not negative.
 */
BOXTEST_AVX2_INLINE unsigned kernel_unpacked_intervals(const struct boxtest_ray *ray,
                                                       const struct boxtest_scales *scales,
                                                       const struct unpacked_node *node, float tmax, __m256 *ret_first,
                                                       __m256 *ret_last)
{
    struct spans spans;
    for (int axis = 0; axis < 3; axis++) {
        const __m256 origin = _mm256_broadcast_ss(&ray->origin[axis]), slack = _mm256_broadcast_ss(&ray->slack[axis]);
        const __m256 first = _mm256_sub_ps(unpacked_planes_at(node, scales->near_at[axis]), origin);
        const __m256 last = _mm256_sub_ps(unpacked_planes_at(node, scales->far_at[axis]), origin);
        spans.near[axis] =
            _mm256_castps_si256(_mm256_fmsub_ps(first, _mm256_broadcast_ss(&scales->inner[axis]), slack));
        spans.far[axis] = _mm256_castps_si256(_mm256_fmadd_ps(last, _mm256_broadcast_ss(&scales->outer[axis]), slack));
    }
    return join_spans(ray, &spans, tmax, ret_first, ret_last);
}

/* Does the same; ret_near are lower bounds of the distances. */
BOXTEST_AVX2_INLINE unsigned kernel_unpacked(const struct boxtest_ray *ray, const struct boxtest_scales *scales,
                                             const struct unpacked_node *node, float tmax, float ret_near[8])
{
    __m256 first, last;
    const unsigned hits = kernel_unpacked_intervals(ray, scales, node, tmax, &first, &last);
    _mm256_storeu_ps(ret_near, first);
    return hits;
}

/* Implements boxtest_avx2(). */
BOXTEST_AVX2_INLINE unsigned kernel_avx2(const struct boxtest_ray *ray, const struct portable_node *node, float tmax,
                                         float ret_near[8])
{
    const unsigned hits = without_empty(node, kernel_avx2_slots(ray, node, tmax, ret_near));
    return __builtin_expect(ray->parallel_axes != 0, 0) ? boxtest_beside(ray, node, hits) : hits;
}

#endif
#endif
