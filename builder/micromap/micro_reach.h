/* SPDX-License-Identifier: Apache-2.0 */
/*
 * micro_reach.h - which cells of a row a micro-triangle touches.
 *
 * Coordinates are in cells (texture_axis.h), and below MICRO_REACH_MAX in magnitude. With SSE2 the left and the right
 * end are computed beside each other; without it the results are the same.
 */
#ifndef BVHD_MICRO_REACH_H
#define BVHD_MICRO_REACH_H

#include <stdint.h>

#if defined(__SSE2__) && !defined(BVHD_SCALAR)
#include <emmintrin.h>
#define MICRO_REACH_SSE2
#endif

#define MICRO_REACH_MAX 0x1p27

/*
 * A micro-triangle relative to one corner, its anchor: that whose other corners are one part of each edge away. Corners
 * 0, 1 and 2 ascend in y. All x are multiplied by `side`, so that corner 1 lies to the right of edge 02. Then the left
 * end of a row is on edge 02, and its right end on the first of edges 01 and 12 that it meets. Of pairs the first is
 * for the left end, the second for the right one. A shape of hardly any height is its box: edge 02 is its left side,
 * and corner 1 stands for the right one.
 */
struct micro_shape {
    double side; /* 1 or -1 */
    double top, bottom; /* y of corners 0 and 2 */
    double x[2], y[2]; /* where the edges begin: corner 0, corner 1 */
    double slopes[2], other_slopes[2]; /* change of x with y: of edges 02 and 01, of edges 02 and 12 */
    double outermost[2]; /* y of the leftmost corner, and of the rightmost */
};

/* A range of cells or of rows, both ends included. */
struct micro_range {
    int64_t first, last;
};

/* Returns the greatest whole number up to x. Within MICRO_REACH_MAX the sum is exact to 2^-24. */
static inline int64_t micro_reach_floor(double x)
{
    return (int64_t)(x + 2 * MICRO_REACH_MAX) - (int64_t)(2 * MICRO_REACH_MAX);
}

static inline double micro_reach_least(double a, double b)
{
    return a < b ? a : b;
}

static inline double micro_reach_greatest(double a, double b)
{
    return a > b ? a : b;
}

#ifdef MICRO_REACH_SSE2

/* A shape at its place. */
struct micro_placed {
    __m128d x, y, slopes, other_slopes, outermost, side;
    double top, bottom;
};

static inline struct micro_placed micro_reach_place(const struct micro_shape *shape, const double anchor[2])
{
    const __m128d down = _mm_set1_pd(anchor[1]), side = _mm_set1_pd(shape->side);
    return (struct micro_placed){
        .x = _mm_add_pd(_mm_mul_pd(side, _mm_set1_pd(anchor[0])), _mm_loadu_pd(shape->x)),
        .y = _mm_add_pd(down, _mm_loadu_pd(shape->y)),
        .slopes = _mm_loadu_pd(shape->slopes),
        .other_slopes = _mm_loadu_pd(shape->other_slopes),
        .outermost = _mm_add_pd(down, _mm_loadu_pd(shape->outermost)),
        .side = side,
        .top = anchor[1] + shape->top,
        .bottom = anchor[1] + shape->bottom,
    };
}

#else

struct micro_placed {
    double x[2], y[2], slopes[2], other_slopes[2], outermost[2], side;
    double top, bottom;
};

static inline struct micro_placed micro_reach_place(const struct micro_shape *shape, const double anchor[2])
{
    struct micro_placed placed = {
        .side = shape->side, .top = anchor[1] + shape->top, .bottom = anchor[1] + shape->bottom};
    for (int end = 0; end < 2; end++) {
        placed.x[end] = shape->side * anchor[0] + shape->x[end];
        placed.y[end] = anchor[1] + shape->y[end];
        placed.slopes[end] = shape->slopes[end];
        placed.other_slopes[end] = shape->other_slopes[end];
        placed.outermost[end] = anchor[1] + shape->outermost[end];
    }
    return placed;
}

#endif

/*
 * Returns the cells that the part of the micro-triangle with y in [from, to], which touches it, reaches with its pad.
 * On the left and on the right that is where it comes nearest to its outermost corner there.
 */
static inline struct micro_range micro_reach_between(const struct micro_placed *placed, double from, double to,
                                                     double pad)
{
    from = micro_reach_greatest(from, placed->top);
    to = micro_reach_least(to, placed->bottom);
#ifdef MICRO_REACH_SSE2
    const __m128d nearest = _mm_min_pd(_mm_max_pd(placed->outermost, _mm_set1_pd(from)), _mm_set1_pd(to));
    const __m128d along = _mm_sub_pd(nearest, placed->y);
    const __m128d across = _mm_min_pd(_mm_mul_pd(placed->slopes, along), _mm_mul_pd(placed->other_slopes, along));
    const __m128d ends = _mm_mul_pd(placed->side, _mm_add_pd(placed->x, across));
    const __m128d swapped = _mm_shuffle_pd(ends, ends, 1);
    const __m128d low = _mm_sub_pd(_mm_min_pd(ends, swapped), _mm_set1_pd(pad));
    const __m128d high = _mm_add_pd(_mm_max_pd(ends, swapped), _mm_set1_pd(pad));
    const __m128d both = _mm_add_pd(_mm_unpacklo_pd(low, high), _mm_set1_pd(2 * MICRO_REACH_MAX));
    const __m128i cells = _mm_sub_epi32(_mm_cvttpd_epi32(both), _mm_set1_epi32((int)(2 * MICRO_REACH_MAX)));
    return (struct micro_range){_mm_cvtsi128_si32(cells), _mm_cvtsi128_si32(_mm_shuffle_epi32(cells, 1))};
#else
    double ends[2];
    for (int end = 0; end < 2; end++) {
        const double nearest = micro_reach_least(micro_reach_greatest(placed->outermost[end], from), to);
        const double along = nearest - placed->y[end];
        const double across = micro_reach_least(placed->slopes[end] * along, placed->other_slopes[end] * along);
        ends[end] = placed->side * (placed->x[end] + across);
    }
    return (struct micro_range){micro_reach_floor(micro_reach_least(ends[0], ends[1]) - pad),
                                micro_reach_floor(micro_reach_greatest(ends[0], ends[1]) + pad)};
#endif
}

/* Returns the rows that the micro-triangle touches with its pad. */
static inline struct micro_range micro_reach_rows(const struct micro_placed *placed, double pad)
{
    return (struct micro_range){micro_reach_floor(placed->top - pad), micro_reach_floor(placed->bottom + pad)};
}

#endif
