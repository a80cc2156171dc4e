/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_quantise_avx2.c - portable_quantise_boxes for machines with AVX2. It handles three axes at a time for values
 * that exist once per axis, and eight slots at a time for values that exist once per slot. It does the same operations
 * in double as portable_quantise.c, so that the bytes are the same.
 */
#include "builder/format/portable_quantise.h"

#include <stddef.h>

#include "builder/format/box_lanes.h"

#if defined(__x86_64__)

bool portable_has_avx2(void)
{
    return __builtin_cpu_supports("avx2");
}

/* The values of the axes x, y, z; the fourth lane repeats z. */
struct wide_grid {
    __m128 origin;
    __m256d inverse;
    __m128i exponent; /* 0 on a flat axis */
};

BOX_LANES_INLINE __m128 lesser_half(__m256 v)
{
    return _mm_min_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps(v, 1));
}

BOX_LANES_INLINE __m128 greater_half(__m256 v)
{
    return _mm_max_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps(v, 1));
}

/* The minimum on each axis. */
BOX_LANES_INLINE __m128 least_of(const __m256 values[3])
{
    __m128 x = lesser_half(values[0]), y = lesser_half(values[1]), z = lesser_half(values[2]);
    __m128 xy = _mm_min_ps(_mm_unpacklo_ps(x, y), _mm_unpackhi_ps(x, y)),
           zz = _mm_min_ps(_mm_unpacklo_ps(z, z), _mm_unpackhi_ps(z, z));
    return _mm_min_ps(_mm_movelh_ps(xy, zz), _mm_movehl_ps(zz, xy));
}

BOX_LANES_INLINE __m128 greatest_of(const __m256 values[3])
{
    __m128 x = greater_half(values[0]), y = greater_half(values[1]), z = greater_half(values[2]);
    __m128 xy = _mm_max_ps(_mm_unpacklo_ps(x, y), _mm_unpackhi_ps(x, y)),
           zz = _mm_max_ps(_mm_unpacklo_ps(z, z), _mm_unpackhi_ps(z, z));
    return _mm_max_ps(_mm_movelh_ps(xy, zz), _mm_movehl_ps(zz, xy));
}

/* Returns the biased exponents of the smallest float powers of two >= values > 0; at least 1. */
BOX_LANES_INLINE __m256i exponents_above(__m256d values)
{
    const __m256i one = _mm256_set1_epi64x(1), mantissa = _mm256_set1_epi64x((INT64_C(1) << 52) - 1);
    __m256i bits = _mm256_castpd_si256(values);
    __m256i exact = _mm256_cmpeq_epi64(_mm256_and_si256(bits, mantissa), _mm256_setzero_si256());
    __m256i exponents = _mm256_add_epi64(_mm256_srli_epi64(bits, 52), _mm256_set1_epi64x(127 - 1023 + 1));
    exponents = _mm256_add_epi64(exponents, exact); /* - 1 */
    return _mm256_blendv_epi8(one, exponents, _mm256_cmpgt_epi64(exponents, one));
}

/* step_of is 2^(exponent - 127), inverse_of is 2^(127 - exponent). */
BOX_LANES_INLINE __m256d step_of(__m256i exponents)
{
    return _mm256_castsi256_pd(_mm256_slli_epi64(_mm256_add_epi64(exponents, _mm256_set1_epi64x(1023 - 127)), 52));
}

BOX_LANES_INLINE __m256d inverse_of(__m256i exponents)
{
    return _mm256_castsi256_pd(_mm256_slli_epi64(_mm256_sub_epi64(_mm256_set1_epi64x(1023 + 127), exponents), 52));
}

BOX_LANES_INLINE __m256d in_steps(__m256d values, __m128 origin, __m256d inverse)
{
    return _mm256_mul_pd(_mm256_sub_pd(values, _mm256_cvtps_pd(origin)), inverse);
}

BOX_LANES_INLINE __m128 next_down(__m128 values)
{
    __m128i bits = _mm_castps_si128(values), minus = _mm_cmpgt_epi32(_mm_setzero_si128(), bits);
    /* Subtracts 1 from positive values, adds 1 to negative ones. */
    __m128i next = _mm_add_epi32(bits, _mm_sub_epi32(_mm_set1_epi32(-1), _mm_slli_epi32(minus, 1)));
    __m128 zero = _mm_cmpeq_ps(values, _mm_setzero_ps());
    return _mm_blendv_ps(_mm_castsi128_ps(next), _mm_set1_ps(-0x1p-149f), zero);
}

/*
 * Returns false, and leaves the node to the plain version, if more than one step down is needed or the float range
 * ends.
 */
BOX_LANES_INLINE bool fit_grid(__m128 low, __m128 high, struct wide_grid *ret_grid)
{
    const __m256d margin = _mm256_set1_pd(PORTABLE_MARGIN), lowest = _mm256_cvtps_pd(low),
                  highest = _mm256_cvtps_pd(high);
    __m256i exponents =
        exponents_above(_mm256_mul_pd(_mm256_sub_pd(highest, lowest), _mm256_set1_pd(PORTABLE_PER_STEPS)));
    __m256d inverse = inverse_of(exponents), wanted = _mm256_sub_pd(lowest, _mm256_mul_pd(step_of(exponents), margin));
    __m128 origin = _mm256_cvtpd_ps(wanted), flat = _mm_cmpnlt_ps(low, high);
    __m256d room = in_steps(lowest, origin, inverse);
    __m256i tight = _mm256_castpd_si256(_mm256_cmp_pd(room, margin, _CMP_LT_OQ));
    __m128i narrow =
        _mm256_castsi256_si128(_mm256_permutevar8x32_epi32(tight, _mm256_setr_epi32(0, 2, 4, 6, 0, 2, 4, 6)));
    origin = _mm_blendv_ps(origin, next_down(origin), _mm_castsi128_ps(narrow));
    room = in_steps(lowest, origin, inverse);
    __m256d left = _mm256_sub_pd(_mm256_set1_pd(256 - PORTABLE_MARGIN), in_steps(highest, origin, inverse));
    __m256d bad =
        _mm256_or_pd(_mm256_cmp_pd(room, margin, _CMP_LT_OQ), _mm256_cmp_pd(left, _mm256_set1_pd(1), _CMP_NGE_UQ));
    bad = _mm256_or_pd(bad, _mm256_cmp_pd(wanted, _mm256_set1_pd(-3e38), _CMP_LT_OQ));
    if (_mm256_movemask_pd(bad) & ~_mm_movemask_ps(flat))
        return false;
    __m128i whole =
        _mm256_castsi256_si128(_mm256_permutevar8x32_epi32(exponents, _mm256_setr_epi32(0, 2, 4, 6, 0, 2, 4, 6)));
    *ret_grid = (struct wide_grid){
        .origin = _mm_blendv_ps(origin, _mm_add_ps(low, _mm_setzero_ps()), flat),
        .inverse = inverse,
        .exponent = _mm_andnot_si128(_mm_castps_si128(flat), whole),
    };
    return true;
}

/* Computes trunc((value - origin) / step - margin) of 8 coordinates, as 16-bit integers. */
BOX_LANES_INLINE __m128i steps_down(__m256 values, __m256d origin, __m256d inverse)
{
    const __m256d margin = _mm256_set1_pd(PORTABLE_MARGIN);
    __m256d low = _mm256_cvtps_pd(_mm256_castps256_ps128(values)),
            high = _mm256_cvtps_pd(_mm256_extractf128_ps(values, 1));
    low = _mm256_sub_pd(_mm256_mul_pd(_mm256_sub_pd(low, origin), inverse), margin);
    high = _mm256_sub_pd(_mm256_mul_pd(_mm256_sub_pd(high, origin), inverse), margin);
    return _mm_packs_epi32(_mm256_cvttpd_epi32(low), _mm256_cvttpd_epi32(high));
}

/* Computes 256 - trunc(256 - margin - (value - origin) / step). */
BOX_LANES_INLINE __m128i steps_up(__m256 values, __m256d origin, __m256d inverse)
{
    const __m256d shift = _mm256_set1_pd(256 - PORTABLE_MARGIN);
    __m256d low = _mm256_cvtps_pd(_mm256_castps256_ps128(values)),
            high = _mm256_cvtps_pd(_mm256_extractf128_ps(values, 1));
    low = _mm256_sub_pd(shift, _mm256_mul_pd(_mm256_sub_pd(low, origin), inverse));
    high = _mm256_sub_pd(shift, _mm256_mul_pd(_mm256_sub_pd(high, origin), inverse));
    return _mm_sub_epi16(_mm_set1_epi16(256), _mm_packs_epi32(_mm256_cvttpd_epi32(low), _mm256_cvttpd_epi32(high)));
}

/* Returns a mask with all bits set in the bytes of slots that are not occupied, in both halves. */
BOX_LANES_INLINE __m128i empty_slots(unsigned occupied)
{
    const __m128i bits = _mm_set1_epi64x(INT64_C(-0x7fbfdfeff7fbfdff)); /* byte s is 1 << s */
    return _mm_cmpeq_epi8(_mm_and_si128(_mm_set1_epi8((char)occupied), bits), _mm_setzero_si128());
}

BOX_LANES_INLINE void store_pair(__m128i first, __m128i second, __m128i clear, __m128i set, uint8_t *ret)
{
    __m128i bytes = _mm_or_si128(_mm_andnot_si128(clear, _mm_packus_epi16(first, second)), set);
    _mm_storeu_si128((__m128i *)(void *)ret, bytes);
}

/* The origin and the inverse of the step of each axis, in every lane. */
struct axes {
    __m256d origins[3], inverses[3];
    bool flat[3];
};

/* Stores the origin and the exponents of a node. Returns the axes of its grid. */
BOX_LANES_INLINE struct axes put_grid(const struct wide_grid *grid, struct portable_node *ret_node)
{
    const __m256d origin = _mm256_cvtps_pd(grid->origin), inverse = grid->inverse;
    struct axes axes = {
        {_mm256_permute4x64_pd(origin, 0), _mm256_permute4x64_pd(origin, 0x55), _mm256_permute4x64_pd(origin, 0xaa)},
        {_mm256_permute4x64_pd(inverse, 0), _mm256_permute4x64_pd(inverse, 0x55), _mm256_permute4x64_pd(inverse, 0xaa)},
        {false, false, false},
    };
    const __m128i packed = _mm_packus_epi16(_mm_packs_epi32(grid->exponent, grid->exponent), _mm_setzero_si128());
    uint32_t exponents = (uint32_t)_mm_cvtsi128_si32(packed) & 0xffffff;
    for (int axis = 0; axis < 3; axis++, exponents >>= 8) {
        ret_node->exponent[axis] = (uint8_t)exponents;
        axes.flat[axis] = (exponents & 0xff) == 0;
    }
    _mm_storel_epi64((__m128i *)(void *)ret_node->origin, _mm_castps_si128(grid->origin));
    _mm_store_ss(&ret_node->origin[2], _mm_movehl_ps(grid->origin, grid->origin));
    return axes;
}

/* Stores the bytes of eight boxes: 24 of their lower sides, and behind them 24 of their upper ones. */
BOX_LANES_INLINE void put_boxes(const struct box_lanes *all, const struct axes *axes, unsigned occupied, uint8_t *ret)
{
    __m128i lo[3], hi[3];
    for (int axis = 0; axis < 3; axis++) {
        lo[axis] = steps_down(all->min[axis], axes->origins[axis], axes->inverses[axis]);
        hi[axis] = steps_up(all->max[axis], axes->origins[axis], axes->inverses[axis]);
        if (axes->flat[axis])
            lo[axis] = hi[axis] = _mm_setzero_si128();
    }
    const __m128i empty = empty_slots(occupied), none = _mm_setzero_si128();
    store_pair(lo[0], lo[1], none, empty, ret);
    store_pair(lo[2], hi[0], _mm_unpackhi_epi64(none, empty), _mm_move_epi64(empty), ret + 16);
    store_pair(hi[1], hi[2], empty, none, ret + 32);
}

_Static_assert(offsetof(struct portable_node, hi) == offsetof(struct portable_node, lo) + 24, "put_boxes fills both");
_Static_assert(offsetof(struct portable_moving_node, end_hi) == offsetof(struct portable_moving_node, end_lo) + 24,
               "put_boxes fills both");

BOX_LANES bool portable_quantise_avx2(const struct box *const boxes[8], unsigned occupied,
                                      struct portable_node *ret_node)
{
    const struct box_lanes all = box_lanes_load(boxes);
    struct wide_grid grid;
    if (!fit_grid(least_of(all.min), greatest_of(all.max), &grid))
        return false;
    const struct axes axes = put_grid(&grid, ret_node);
    put_boxes(&all, &axes, occupied, (uint8_t *)ret_node + offsetof(struct portable_node, lo));
    return true;
}

BOX_LANES bool portable_quantise_moving_avx2(const struct box *const start[8], const struct box *const end[8],
                                             unsigned occupied, struct portable_moving_node *ret_node)
{
    const struct box_lanes first = box_lanes_load(start), last = box_lanes_load(end);
    struct wide_grid grid;
    if (!fit_grid(_mm_min_ps(least_of(first.min), least_of(last.min)),
                  _mm_max_ps(greatest_of(first.max), greatest_of(last.max)), &grid))
        return false;
    const struct axes axes = put_grid(&grid, &ret_node->start);
    put_boxes(&first, &axes, occupied, (uint8_t *)ret_node + offsetof(struct portable_node, lo));
    put_boxes(&last, &axes, occupied, (uint8_t *)ret_node + offsetof(struct portable_moving_node, end_lo));
    return true;
}

#else

bool portable_has_avx2(void)
{
    return false;
}

bool portable_quantise_avx2(const struct box *const boxes[8], unsigned occupied, struct portable_node *ret_node)
{
    (void)boxes, (void)occupied, (void)ret_node;
    return false;
}

bool portable_quantise_moving_avx2(const struct box *const start[8], const struct box *const end[8], unsigned occupied,
                                   struct portable_moving_node *ret_node)
{
    (void)start, (void)end, (void)occupied, (void)ret_node;
    return false;
}

#endif

static void transpose(const struct box *const boxes[8], struct portable_boxes *ret)
{
    for (int slot = 0; slot < 8; slot++)
        for (int axis = 0; axis < 3; axis++) {
            ret->min[axis][slot] = boxes[slot]->min[axis];
            ret->max[axis][slot] = boxes[slot]->max[axis];
        }
}

void portable_quantise_boxes(const struct box *const boxes[8], unsigned occupied, bool avx2,
                             struct portable_node *ret_node)
{
    struct portable_boxes transposed;
    if (avx2 && portable_quantise_avx2(boxes, occupied, ret_node))
        return;
    transpose(boxes, &transposed);
    portable_quantise(&transposed, occupied, ret_node);
}

void portable_quantise_moving_boxes(const struct box *const start[8], const struct box *const end[8], unsigned occupied,
                                    bool avx2, struct portable_moving_node *ret_node)
{
    struct portable_boxes first, last;
    if (avx2 && portable_quantise_moving_avx2(start, end, occupied, ret_node))
        return;
    transpose(start, &first);
    transpose(end, &last);
    portable_quantise_moving(&first, &last, occupied, ret_node);
}
