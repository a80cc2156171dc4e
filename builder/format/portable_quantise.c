/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable_quantise.h"

#include <float.h>

#if defined(__SSE2__) && !defined(BVHD_SCALAR)
#define USE_SSE2 1
#include <emmintrin.h>
#endif

static const double MARGIN = PORTABLE_MARGIN, PER_STEPS = PORTABLE_PER_STEPS;

static double power_of_two(int exponent)
{
    uint64_t bits = (uint64_t)(exponent + 1023) << 52;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static float next_down(float value)
{
    uint32_t bits;
    if (value == 0)
        return -0x1p-149f;
    memcpy(&bits, &value, sizeof bits);
    bits += value > 0 ? UINT32_C(0xffffffff) : 1;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Returns the biased exponent of the smallest float power of two that is >= value > 0; at least 1. */
static int exponent_above(double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    int exponent = (int)(bits >> 52) - 1023 + ((bits & ((UINT64_C(1) << 52) - 1)) != 0);
    return exponent + 127 > 1 ? exponent + 127 : 1;
}

/* Returns the largest float that is at least the margin below `low`. */
static float origin_below(float low, double step, double inverse)
{
    double wanted = low - step * MARGIN;
    if (wanted <= -FLT_MAX)
        return -FLT_MAX;
    float origin = (float)wanted;
    while (((double)low - origin) * inverse < MARGIN && origin > -FLT_MAX)
        origin = next_down(origin);
    return origin;
}

struct grid {
    float origin;
    double inverse; /* of the step */
    uint8_t exponent;
};

static struct grid fit_grid(float low, float high)
{
    int exponent = exponent_above(((double)high - low) * PER_STEPS);
    for (;; exponent++) {
        double inverse = power_of_two(127 - exponent);
        float origin = origin_below(low, power_of_two(exponent - 127), inverse);
        /* The same expression as in quantise(), so that hi is at most 255. */
        if (256 - MARGIN - (high - (double)origin) * inverse >= 1)
            return (struct grid){origin, inverse, (uint8_t)exponent};
    }
}

/*
 * Truncation rounds non-negative numbers down, and rounds up when counted from the other end. Both versions do the same
 * operations in double.
 */
#ifdef USE_SSE2

/* Computes trunc(offset + sign * ((value - origin) / step)) of 8 coordinates, as 16-bit integers. */
static inline __m128i in_steps(const float values[8], const struct grid *grid, double offset, __m128d sign)
{
    const __m128d origin = _mm_set1_pd(grid->origin), inverse = _mm_set1_pd(grid->inverse), shift = _mm_set1_pd(offset);
    __m128i pairs[4];
    for (int i = 0; i < 4; i++) {
        __m128 two = _mm_castsi128_ps(_mm_loadl_epi64((const __m128i *)(const void *)(values + 2 * i)));
        __m128d steps = _mm_mul_pd(_mm_sub_pd(_mm_cvtps_pd(two), origin), inverse);
        steps = _mm_add_pd(_mm_xor_pd(steps, sign), shift);
        pairs[i] = _mm_cvttpd_epi32(steps);
    }
    return _mm_packs_epi32(_mm_unpacklo_epi64(pairs[0], pairs[1]), _mm_unpacklo_epi64(pairs[2], pairs[3]));
}

static inline void store_bytes(__m128i words, uint8_t ret[8])
{
    _mm_storel_epi64((__m128i *)(void *)ret, _mm_packus_epi16(words, words));
}

static inline void quantise(const float min[8], const float max[8], const struct grid *grid, uint8_t ret_lo[8],
                            uint8_t ret_hi[8])
{
    store_bytes(in_steps(min, grid, -MARGIN, _mm_setzero_pd()), ret_lo);
    store_bytes(_mm_sub_epi16(_mm_set1_epi16(256), in_steps(max, grid, 256 - MARGIN, _mm_set1_pd(-0.0))), ret_hi);
}

#else

static void quantise(const float min[8], const float max[8], const struct grid *grid, uint8_t ret_lo[8],
                     uint8_t ret_hi[8])
{
    double origin = grid->origin, inverse = grid->inverse;
    for (int slot = 0; slot < 8; slot++) {
        ret_lo[slot] = (uint8_t)(int32_t)((min[slot] - origin) * inverse - MARGIN);
        ret_hi[slot] = (uint8_t)(256 - (int32_t)((256 - MARGIN) - (max[slot] - origin) * inverse));
    }
}

#endif

static void clear_empty(unsigned occupied, uint8_t lo[8], uint8_t hi[8])
{
    for (int slot = 0; slot < 8; slot++)
        if (!(occupied >> slot & 1)) {
            lo[slot] = 255;
            hi[slot] = 0;
        }
}

/* The halving order compiles to few instructions. */
static inline float least_of(const float values[8])
{
    float least[4];
    for (int i = 0; i < 4; i++)
        least[i] = values[i] < values[i + 4] ? values[i] : values[i + 4];
    float a = least[0] < least[2] ? least[0] : least[2], b = least[1] < least[3] ? least[1] : least[3];
    return a < b ? a : b;
}

static inline float greatest_of(const float values[8])
{
    float greatest[4];
    for (int i = 0; i < 4; i++)
        greatest[i] = values[i] > values[i + 4] ? values[i] : values[i + 4];
    float a = greatest[0] > greatest[2] ? greatest[0] : greatest[2],
          b = greatest[1] > greatest[3] ? greatest[1] : greatest[3];
    return a > b ? a : b;
}

/* Returns the grid that holds coordinates from `low` to `high`; its exponent is 0 if these are equal. */
static struct grid grid_over(float low, float high)
{
    if (low < high)
        return fit_grid(low, high);
    return (struct grid){low + 0.0f, 0, 0}; /* turns -0 into 0, whichever zero came first */
}

/* Fills the bytes of one axis. */
static void put_axis(const float min[8], const float max[8], const struct grid *grid, unsigned occupied, uint8_t lo[8],
                     uint8_t hi[8])
{
    if (grid->exponent > 0) {
        quantise(min, max, grid, lo, hi);
    } else {
        memset(lo, 0, 8);
        memset(hi, 0, 8);
    }
    if (occupied != 0xff)
        clear_empty(occupied, lo, hi);
}

static void put_grid(const struct grid *grid, int axis, struct portable_node *node)
{
    node->origin[axis] = grid->origin;
    node->exponent[axis] = grid->exponent;
}

void portable_quantise(const struct portable_boxes *boxes, unsigned occupied, struct portable_node *ret_node)
{
    for (int axis = 0; axis < 3; axis++) {
        const float *min = boxes->min[axis], *max = boxes->max[axis];
        const struct grid grid = grid_over(least_of(min), greatest_of(max));
        put_axis(min, max, &grid, occupied, ret_node->lo[axis], ret_node->hi[axis]);
        put_grid(&grid, axis, ret_node);
    }
}

void portable_quantise_moving(const struct portable_boxes *start, const struct portable_boxes *end, unsigned occupied,
                              struct portable_moving_node *ret_node)
{
    struct portable_node *node = &ret_node->start;
    for (int axis = 0; axis < 3; axis++) {
        const float low = least_of(start->min[axis]), end_low = least_of(end->min[axis]),
                    high = greatest_of(start->max[axis]), end_high = greatest_of(end->max[axis]);
        const struct grid grid = grid_over(low < end_low ? low : end_low, high > end_high ? high : end_high);
        put_axis(start->min[axis], start->max[axis], &grid, occupied, node->lo[axis], node->hi[axis]);
        put_axis(end->min[axis], end->max[axis], &grid, occupied, ret_node->end_lo[axis], ret_node->end_hi[axis]);
        put_grid(&grid, axis, node);
    }
}
