/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/wide/octants.h"

#include <string.h>

#if defined(__SSE2__) && !defined(BVHD_SCALAR)
#define USE_SSE2 1
#include <emmintrin.h>
#endif

/*
 * The method is a local search: children start in the slots of their own numbers, and pairs of slots exchange their
 * children where both together gain. For each difference of slot numbers (1 .. 7) there are four disjoint pairs, which
 * are processed together. Two rounds through all differences, far ones first, come within half a percent of where the
 * search would end.
 *
 * For a pair only those axes count on which its slots differ; there the signs of the two slots are opposite, so an
 * exchange negates the pair's sum. The child's number is kept in the lowest bits of its x.
 */
enum { NUMBER = 7 };

#ifdef USE_SSE2

struct half {
    __m128 x, y, z; /* offsets of the children in four slots */
};

#define PERMUTE(difference, v)                                                                                         \
    ((difference & 3) == 0   ? (v)                                                                                     \
     : (difference & 3) == 1 ? _mm_shuffle_ps(v, v, _MM_SHUFFLE(2, 3, 0, 1))                                           \
     : (difference & 3) == 2 ? _mm_shuffle_ps(v, v, _MM_SHUFFLE(1, 0, 3, 2))                                           \
                             : _mm_shuffle_ps(v, v, _MM_SHUFFLE(0, 1, 2, 3)))

/* Returns what four slots gain by their children on the axes of `difference`; z_sign is 0 for +. */
static inline __attribute__((always_inline)) __m128 gain(const struct half *half, int difference, __m128 z_sign)
{
    const __m128 x_sign = _mm_castsi128_ps(_mm_setr_epi32(INT32_MIN, 0, INT32_MIN, 0));
    const __m128 y_sign = _mm_castsi128_ps(_mm_setr_epi32(INT32_MIN, INT32_MIN, 0, 0));
    __m128 sum = _mm_setzero_ps();
    if (difference & 1)
        sum = _mm_add_ps(sum, _mm_xor_ps(half->x, x_sign));
    if (difference & 2)
        sum = _mm_add_ps(sum, _mm_xor_ps(half->y, y_sign));
    if (difference & 4)
        sum = _mm_add_ps(sum, _mm_xor_ps(half->z, z_sign));
    return sum;
}

static inline __m128 choose(__m128 mask, __m128 yes, __m128 no)
{
    return _mm_xor_ps(no, _mm_and_ps(mask, _mm_xor_ps(yes, no)));
}

static inline __attribute__((always_inline)) struct half exchange_half(const struct half *own, const struct half *other,
                                                                       int difference, __m128 mask)
{
    return (struct half){choose(mask, PERMUTE(difference, other->x), own->x),
                         choose(mask, PERMUTE(difference, other->y), own->y),
                         choose(mask, PERMUTE(difference, other->z), own->z)};
}

static inline __attribute__((always_inline)) void exchange(struct half halves[2], int difference)
{
    const __m128 minus = _mm_castsi128_ps(_mm_set1_epi32(INT32_MIN)), plus = _mm_setzero_ps();
    __m128 low = gain(&halves[0], difference, minus), high = gain(&halves[1], difference, plus);
    __m128 low_partner = difference & 4 ? high : low, high_partner = difference & 4 ? low : high;
    __m128 low_mask = _mm_cmplt_ps(_mm_add_ps(low, PERMUTE(difference, low_partner)), _mm_setzero_ps());
    __m128 high_mask = _mm_cmplt_ps(_mm_add_ps(high, PERMUTE(difference, high_partner)), _mm_setzero_ps());
    struct half a = exchange_half(&halves[0], &halves[difference >> 2], difference, low_mask);
    struct half b = exchange_half(&halves[1], &halves[1 - (difference >> 2)], difference, high_mask);
    halves[0] = a;
    halves[1] = b;
}

void octants_assign(const float offsets[8][4], unsigned rounds, uint8_t ret_children[8])
{
    const __m128i number = _mm_set1_epi32(NUMBER), low = _mm_setr_epi32(0, 1, 2, 3), high = _mm_setr_epi32(4, 5, 6, 7);
    struct half halves[2];
    for (int i = 0; i < 2; i++) {
        const float(*rows)[4] = offsets + 4 * i;
        __m128 a = _mm_loadu_ps(rows[0]), b = _mm_loadu_ps(rows[1]), c = _mm_loadu_ps(rows[2]),
               d = _mm_loadu_ps(rows[3]);
        _MM_TRANSPOSE4_PS(a, b, c, d);
        halves[i].x = _mm_castsi128_ps(_mm_or_si128(_mm_andnot_si128(number, _mm_castps_si128(a)), i ? high : low));
        halves[i].y = b;
        halves[i].z = c;
    }
    for (unsigned round = 0; round < rounds; round++) {
        exchange(halves, 7);
        exchange(halves, 6);
        exchange(halves, 5);
        exchange(halves, 3);
        exchange(halves, 1);
        exchange(halves, 2);
        exchange(halves, 4);
    }
    __m128i first = _mm_and_si128(_mm_castps_si128(halves[0].x), number),
            second = _mm_and_si128(_mm_castps_si128(halves[1].x), number);
    __m128i bytes = _mm_packus_epi16(_mm_packs_epi32(first, second), _mm_setzero_si128());
    _mm_storel_epi64((__m128i *)(void *)ret_children, bytes);
}

#else

/* Computes the same sums in the same order, slot by slot. */
static float gain(float children[8][3], int slot, int difference)
{
    float sum = 0;
    for (int axis = 0; axis < 3; axis++)
        if (difference >> axis & 1)
            sum += slot >> axis & 1 ? children[slot][axis] : -children[slot][axis];
    return sum;
}

static void exchange(float children[8][3], int difference)
{
    for (int slot = 0; slot < 8; slot++) {
        int partner = slot ^ difference;
        if (partner < slot || !(gain(children, slot, difference) + gain(children, partner, difference) < 0))
            continue;
        float kept[3];
        memcpy(kept, children[slot], sizeof kept);
        memcpy(children[slot], children[partner], sizeof kept);
        memcpy(children[partner], kept, sizeof kept);
    }
}

void octants_assign(const float offsets[8][4], unsigned rounds, uint8_t ret_children[8])
{
    static const int differences[] = {7, 6, 5, 3, 1, 2, 4};
    float children[8][3];
    uint32_t bits;
    for (uint32_t i = 0; i < 8; i++) {
        memcpy(&bits, &offsets[i][0], sizeof bits);
        bits = (bits & ~(uint32_t)NUMBER) | i;
        memcpy(&children[i][0], &bits, sizeof bits);
        children[i][1] = offsets[i][1];
        children[i][2] = offsets[i][2];
    }
    for (unsigned round = 0; round < rounds; round++)
        for (int i = 0; i < 7; i++)
            exchange(children, differences[i]);
    for (int slot = 0; slot < 8; slot++) {
        memcpy(&bits, &children[slot][0], sizeof bits);
        ret_children[slot] = bits & NUMBER;
    }
}

#endif
