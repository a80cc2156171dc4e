/* SPDX-License-Identifier: Apache-2.0 */
/*
 * packet_triangle.h - the rays of a packet against a triangle, four at a time, with the operations and so with the
 * answers of triangle_avx2.h. Internal to packet_avx2.c.
 */
#ifndef BVHD_PACKET_TRIANGLE_H
#define BVHD_PACKET_TRIANGLE_H

#include "builder/traverse/packet_times.h"

#ifdef BOXTEST_AVX2

/* The kind of structure that a packet walks through. The walk is compiled once for each kind. */
enum packet_kind {
    PACKET_TRIANGLES,
    PACKET_MOVING, /* motion triangles, by rays of one time */
    PACKET_TIMES, /* the same, by rays of different times */
    PACKET_TOP,
    PACKET_MOVING_TOP, /* motion instances, by rays of one time */
    PACKET_TIMES_TOP, /* the same, by rays of different times */
    PACKET_SPHERES,
    PACKET_SWEPT /* linear swept spheres */
};

static inline bool kind_is_top(enum packet_kind kind)
{
    return kind == PACKET_TOP || kind == PACKET_MOVING_TOP || kind == PACKET_TIMES_TOP;
}

static inline bool kind_has_times(enum packet_kind kind)
{
    return kind == PACKET_TIMES || kind == PACKET_TIMES_TOP;
}

static inline bool kind_moves(enum packet_kind kind)
{
    return kind == PACKET_MOVING || kind == PACKET_MOVING_TOP || kind_has_times(kind);
}

static inline bool kind_is_round(enum packet_kind kind)
{
    return kind == PACKET_SPHERES || kind == PACKET_SWEPT;
}

/* The hits of four rays at one triangle. */
struct packet_hits {
    double t[4], u[4], v[4], sum[4];
    uint32_t maybe, is_clear; /* lanes: the ray can meet the triangle; the numbers above are its hit */
};

BOXTEST_AVX2_INLINE __m256d spread(const float *from)
{
    return _mm256_cvtps_pd(_mm_broadcast_ss(from));
}

/* The corners of a triangle: where all rays see them, or where each of four rays does at its own time. */
struct packet_corners {
    const float *corners[3];
    struct times_corners times;
};

/* Returns a coordinate of a corner for four rays. */
BOXTEST_AVX2_INLINE __m256d coordinate(const struct packet_corners *corners, int corner, int axis,
                                       enum packet_kind kind)
{
    if (kind == PACKET_TIMES)
        return _mm256_cvtps_pd(_mm_loadu_ps(corners->times.at[corner][axis]));
    return spread(&corners->corners[corner][axis]);
}

/* Returns a coordinate of a corner relative to the rays' origins, along the k-th axis in each ray's order. */
BOXTEST_AVX2_INLINE __m256d move_along(const struct packet_triangles *ray, const int *const orders[3], bool is_mixed,
                                       int k, const struct packet_corners *corners, int corner, enum packet_kind kind)
{
    __m256d at = coordinate(corners, corner, orders[0][k], kind);
    if (is_mixed)
        at = choose(at, coordinate(corners, corner, orders[1][k], kind),
                    coordinate(corners, corner, orders[2][k], kind), ray);
    return _mm256_sub_pd(at, ray->origin[k]);
}

/* Does the work of triangle_avx2_intersect() for four rays and one triangle, with the same operations. */
BOXTEST_AVX2_INLINE void meet_four(const struct packet_triangles *ray, const int *const orders[3], bool is_mixed,
                                   const struct packet_corners *corners, uint32_t lanes, enum packet_kind kind,
                                   struct packet_hits *ret_hits)
{
    const __m256d sign = _mm256_set1_pd(-0.0);
    __m256d x[3], y[3], z[3], left[3], right[3], below, above;
    for (int k = 0; k < 3; k++) {
        const __m256d depth = move_along(ray, orders, is_mixed, 2, corners, k, kind);
        x[k] =
            _mm256_sub_pd(move_along(ray, orders, is_mixed, 0, corners, k, kind), _mm256_mul_pd(ray->shear[0], depth));
        y[k] =
            _mm256_sub_pd(move_along(ray, orders, is_mixed, 1, corners, k, kind), _mm256_mul_pd(ray->shear[1], depth));
        z[k] = _mm256_mul_pd(ray->shear[2], depth);
    }
    below = above = _mm256_setzero_pd();
    __m256d is_signed = _mm256_castsi256_pd(_mm256_set1_epi64x(-1));
    for (int k = 0; k < 3; k++) {
        const int from = (k + 1) % 3, to = (k + 2) % 3;
        left[k] = _mm256_mul_pd(x[to], y[from]);
        right[k] = _mm256_mul_pd(y[to], x[from]);
        const __m256d is_below = _mm256_cmp_pd(left[k], right[k], _CMP_LT_OQ),
                      is_above = _mm256_cmp_pd(left[k], right[k], _CMP_GT_OQ);
        below = _mm256_or_pd(below, is_below);
        above = _mm256_or_pd(above, is_above);
        is_signed = _mm256_and_pd(is_signed, _mm256_or_pd(is_below, is_above));
    }
    ret_hits->maybe = ~(uint32_t)_mm256_movemask_pd(_mm256_and_pd(below, above)) & lanes;
    if (ret_hits->maybe == 0)
        return;
    __m256d edges[3], sizes[3];
    for (int k = 0; k < 3; k++) {
        edges[k] = _mm256_sub_pd(left[k], right[k]);
        sizes[k] = _mm256_add_pd(_mm256_andnot_pd(sign, left[k]), _mm256_andnot_pd(sign, right[k]));
    }
    const __m256d sum = _mm256_add_pd(_mm256_add_pd(edges[0], edges[1]), edges[2]), size = _mm256_andnot_pd(sign, sum),
                  products = _mm256_add_pd(_mm256_add_pd(sizes[0], sizes[1]), sizes[2]);
    const __m256d is_large =
        _mm256_cmp_pd(size, _mm256_mul_pd(_mm256_set1_pd(2 * triangle_cancellation), products), _CMP_GE_OQ);
    const __m256d is_finite = _mm256_cmp_pd(size, _mm256_set1_pd(DBL_MAX), _CMP_LE_OQ);
    ret_hits->is_clear = (uint32_t)_mm256_movemask_pd(_mm256_and_pd(is_signed, _mm256_and_pd(is_large, is_finite)));
    for (int k = 0; k < 3; k++)
        edges[k] = _mm256_div_pd(edges[k], sum);
    _mm256_storeu_pd(ret_hits->t,
                     _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(edges[0], z[0]), _mm256_mul_pd(edges[1], z[1])),
                                   _mm256_mul_pd(edges[2], z[2])));
    _mm256_storeu_pd(ret_hits->u, edges[1]);
    _mm256_storeu_pd(ret_hits->v, edges[2]);
    _mm256_storeu_pd(ret_hits->sum, sum);
}

#endif
#endif
