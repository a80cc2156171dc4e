/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vec4.h - computes with four floats at once, for the loops over refs: the compiler's vector type, and the few
 * operations for which it has no operator.
 *
 * On x86-64 each operation is one or two SSE2 instructions; elsewhere plain loops give the same results. vec4_min(a, b)
 * is a < b ? a : b in each lane, so a NaN in `a` gives `b`.
 */
#ifndef BVHD_VEC4_H
#define BVHD_VEC4_H

#include <stdint.h>
#include <string.h>

#include "proto/base/box.h"

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

typedef float vec4 __attribute__((vector_size(16)));
typedef int32_t vec4_int __attribute__((vector_size(16)));
typedef float vec4_loose
    __attribute__((vector_size(16), aligned(4), may_alias)); /* in memory, with the alignment of a float */

static inline vec4 vec4_all(float value)
{
    return (vec4){value, value, value, value};
}

/* Loads three floats and a zero, without reading a fourth. */
static inline vec4 vec4_load3(const float at[3])
{
#if defined(__SSE2__)
    double xy;
    memcpy(&xy, at, sizeof xy);
    return _mm_movelh_ps(_mm_castpd_ps(_mm_set_sd(xy)), _mm_set_ss(at[2]));
#else
    return (vec4){at[0], at[1], at[2], 0};
#endif
}

static inline vec4 vec4_min(vec4 a, vec4 b)
{
#if defined(__SSE2__)
    return _mm_min_ps(a, b);
#else
    for (int lane = 0; lane < 4; lane++)
        a[lane] = a[lane] < b[lane] ? a[lane] : b[lane];
    return a;
#endif
}

static inline vec4 vec4_max(vec4 a, vec4 b)
{
#if defined(__SSE2__)
    return _mm_max_ps(a, b);
#else
    for (int lane = 0; lane < 4; lane++)
        a[lane] = a[lane] > b[lane] ? a[lane] : b[lane];
    return a;
#endif
}

/* Returns y z x w of x y z w. */
static inline vec4 vec4_rotate(vec4 v)
{
#if defined(__SSE2__)
    return _mm_shuffle_ps(v, v, _MM_SHUFFLE(3, 0, 2, 1));
#else
    return (vec4){v[1], v[2], v[0], v[3]};
#endif
}

/* Returns the vectors of the first, second and third lanes of three vectors. The fourth lanes have no meaning. */
static inline void vec4_transpose3(vec4 a, vec4 b, vec4 c, vec4 *ret_x, vec4 *ret_y, vec4 *ret_z)
{
#if defined(__SSE2__)
    vec4 xy = _mm_unpacklo_ps(a, b);
    *ret_x = _mm_shuffle_ps(xy, c, _MM_SHUFFLE(0, 0, 1, 0));
    *ret_y = _mm_shuffle_ps(xy, c, _MM_SHUFFLE(1, 1, 3, 2));
    *ret_z = _mm_shuffle_ps(_mm_unpackhi_ps(a, b), c, _MM_SHUFFLE(2, 2, 1, 0));
#else
    *ret_x = (vec4){a[0], b[0], c[0], 0};
    *ret_y = (vec4){a[1], b[1], c[1], 0};
    *ret_z = (vec4){a[2], b[2], c[2], 0};
#endif
}

/* Returns the lanes of a comparison (each all ones or all zeros) as bits: bit `lane` is set where it is true. */
static inline unsigned vec4_bits(vec4_int comparison)
{
#if defined(__SSE2__)
    return (unsigned)_mm_movemask_ps((__m128)comparison);
#else
    unsigned bits = 0;
    for (int lane = 0; lane < 4; lane++)
        bits |= (unsigned)(comparison[lane] != 0) << lane;
    return bits;
#endif
}

/* Bitwise operations, as on integers. */
static inline vec4 vec4_and(vec4 v, vec4_int mask)
{
    return (vec4)((vec4_int)v & mask);
}

static inline vec4 vec4_or(vec4 v, vec4_int mask)
{
    return (vec4)((vec4_int)v | mask);
}

/* Returns `a` where the mask's lane is all ones, `b` where it is zero. */
static inline vec4 vec4_select(vec4_int mask, vec4 a, vec4 b)
{
    return (vec4)(((vec4_int)a & mask) | ((vec4_int)b & ~mask));
}

static inline vec4 vec4_abs(vec4 v)
{
    return vec4_and(v, (vec4_int){INT32_MAX, INT32_MAX, INT32_MAX, INT32_MAX});
}

/* Clears the fourth lane. */
static inline vec4 vec4_xyz(vec4 v)
{
    return vec4_and(v, (vec4_int){-1, -1, -1, 0});
}

/* A struct box in registers. */
struct vec4_box {
    vec4 min, max;
};

/* Returns a box that contains nothing, and that grows to any box added to it. */
static inline struct vec4_box vec4_box_empty(void)
{
    return (struct vec4_box){vec4_all(FLT_MAX), vec4_all(-FLT_MAX)};
}

static inline struct vec4_box vec4_box_from(const struct box *box)
{
    return (struct vec4_box){vec4_load3(box->min), vec4_load3(box->max)};
}

static inline struct box vec4_box_get(struct vec4_box box)
{
    return (struct box){{box.min[0], box.min[1], box.min[2]}, {box.max[0], box.max[1], box.max[2]}};
}

/*
 * Loads or stores 32 bytes with the alignment of a float, such as a struct primitive_ref: minimum, one lane, maximum,
 * one lane.
 */
static inline struct vec4_box vec4_box_load(const void *at)
{
    const vec4_loose *from = at;
    return (struct vec4_box){from[0], from[1]};
}

static inline void vec4_box_store(void *at, struct vec4_box box)
{
    vec4_loose *to = at;
    to[0] = box.min;
    to[1] = box.max;
}

/* Stores a packed struct box (24 bytes). */
static inline void vec4_box_put(struct vec4_box box, struct box *to)
{
#if defined(__SSE2__)
    vec4 middle = _mm_shuffle_ps(box.min, box.max, _MM_SHUFFLE(0, 0, 2, 2));
    double end = _mm_cvtsd_f64(_mm_castps_pd(_mm_shuffle_ps(box.max, box.max, _MM_SHUFFLE(2, 1, 2, 1))));
    *(vec4_loose *)(void *)to = _mm_shuffle_ps(box.min, middle, _MM_SHUFFLE(2, 0, 1, 0));
    memcpy(&to->max[1], &end, sizeof end);
#else
    *to = vec4_box_get(box);
#endif
}

/* Returns half of the surface area. */
static inline float vec4_box_half_area(struct vec4_box box)
{
    vec4 size = box.max - box.min, sides = size * vec4_rotate(size);
    return sides[0] + sides[1] + sides[2];
}

/* Returns the same as box_half_area, computed in double. */
static inline double vec4_box_half_area_double(struct vec4_box box)
{
#if defined(__SSE2__)
    /* The fourth lanes may hold values that are slow to convert. */
    vec4 min = vec4_xyz(box.min), max = vec4_xyz(box.max);
    __m128d xy = _mm_sub_pd(_mm_cvtps_pd(max), _mm_cvtps_pd(min));
    __m128d z = _mm_sub_pd(_mm_cvtps_pd(_mm_movehl_ps(max, max)), _mm_cvtps_pd(_mm_movehl_ps(min, min)));
    double x = _mm_cvtsd_f64(xy), y = _mm_cvtsd_f64(_mm_unpackhi_pd(xy, xy)), depth = _mm_cvtsd_f64(z);
    return x * y + y * depth + depth * x;
#else
    struct box plain = vec4_box_get(box);
    return box_half_area(&plain);
#endif
}

/* Grows the box by another one; NaNs in `min` and `max` are ignored. */
static inline void vec4_box_grow(struct vec4_box *box, vec4 min, vec4 max)
{
    box->min = vec4_min(min, box->min);
    box->max = vec4_max(max, box->max);
}

#endif
