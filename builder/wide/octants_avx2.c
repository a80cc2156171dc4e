/* SPDX-License-Identifier: Apache-2.0 */
/*
 * octants_avx2.c - octants_assign_boxes: the search of octants.c with AVX2, eight slots in a register. The sums are the
 * same, so the result is too.
 */
#include <string.h>

#include "builder/format/box_lanes.h"
#include "builder/wide/octants.h"

/* Offsets are a sixteenth of twice the distance between centres, so that no sum of six of them overflows. */
static const float SHARE = 0.0625f;

static void assign_plain(const struct box *parent, const struct box *const children[8], unsigned count, unsigned rounds,
                         uint8_t ret_children[8])
{
    float offsets[8][4] = {{0}}, centre[3];
    for (int axis = 0; axis < 3; axis++)
        centre[axis] = SHARE * parent->min[axis] + SHARE * parent->max[axis];
    for (unsigned i = 0; i < count; i++)
        for (int axis = 0; axis < 3; axis++)
            offsets[i][axis] = SHARE * children[i]->min[axis] + SHARE * children[i]->max[axis] - centre[axis];
    octants_assign((const float(*)[4])offsets, rounds, ret_children);
}

#ifdef __x86_64__

bool octants_has_avx2(void)
{
    return __builtin_cpu_supports("avx2");
}

struct slots {
    __m256 x, y, z; /* offsets of the children in the slots */
};

BOX_LANES_INLINE __m256i slot_numbers(void)
{
    return _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
}

/* Returns, for each slot, the value of its partner, whose number differs in the bits of `difference`. */
BOX_LANES_INLINE __m256 permute(__m256 v, int difference)
{
    return _mm256_permutevar8x32_ps(v, _mm256_xor_si256(slot_numbers(), _mm256_set1_epi32(difference)));
}

/* Unlike octants.c this sum has no first summand 0, which affects only the sign of a zero. */
BOX_LANES_INLINE __m256 gain(const struct slots *s, int difference)
{
    const __m256 x_sign = _mm256_setr_ps(-0.0f, 0, -0.0f, 0, -0.0f, 0, -0.0f, 0);
    const __m256 y_sign = _mm256_setr_ps(-0.0f, -0.0f, 0, 0, -0.0f, -0.0f, 0, 0);
    const __m256 z_sign = _mm256_setr_ps(-0.0f, -0.0f, -0.0f, -0.0f, 0, 0, 0, 0);
    __m256 x = _mm256_xor_ps(s->x, x_sign), y = _mm256_xor_ps(s->y, y_sign), z = _mm256_xor_ps(s->z, z_sign);
    __m256 xy = difference & 1 ? difference & 2 ? _mm256_add_ps(x, y) : x : y;
    return difference & 3 ? difference & 4 ? _mm256_add_ps(xy, z) : xy : z;
}

/*
 * Each slot compares what its own child and its partner's child gain on the axes of `difference`. In the partner's slot
 * all signs are opposite, and so is what the partner's child gains there: a + b < 0 exactly if a < -b. Both slots
 * decide alike, so they exchange their children or keep them.
 */
BOX_LANES_INLINE struct slots exchange(struct slots own, int difference)
{
    __m256 own_gain = gain(&own, difference),
           other_gain = _mm256_xor_ps(permute(own_gain, difference), _mm256_set1_ps(-0.0f));
    __m256i mask = _mm256_castps_si256(_mm256_cmp_ps(own_gain, other_gain, _CMP_LT_OQ));
    __m256i from = _mm256_xor_si256(slot_numbers(), _mm256_and_si256(mask, _mm256_set1_epi32(difference)));
    return (struct slots){_mm256_permutevar8x32_ps(own.x, from), _mm256_permutevar8x32_ps(own.y, from),
                          _mm256_permutevar8x32_ps(own.z, from)};
}

/* Returns the offsets on one axis; 0 for children that do not exist. */
BOX_LANES_INLINE __m256 offsets(__m256 min, __m256 max, float parent_min, float parent_max, __m256 there)
{
    const __m256 share = _mm256_set1_ps(SHARE);
    __m256 centre = _mm256_set1_ps(SHARE * parent_min + SHARE * parent_max);
    return _mm256_and_ps(there,
                         _mm256_sub_ps(_mm256_add_ps(_mm256_mul_ps(share, min), _mm256_mul_ps(share, max)), centre));
}

BOX_LANES static void assign_avx2(const struct box *parent, const struct box *const children[8], unsigned count,
                                  unsigned rounds, uint8_t ret_children[8])
{
    const __m256i numbers = slot_numbers(), low_bits = _mm256_set1_epi32(7);
    __m256 there = _mm256_castsi256_ps(_mm256_cmpgt_epi32(_mm256_set1_epi32((int32_t)count), numbers));
    struct box_lanes boxes = box_lanes_load(children);
    struct slots s = {offsets(boxes.min[0], boxes.max[0], parent->min[0], parent->max[0], there),
                      offsets(boxes.min[1], boxes.max[1], parent->min[1], parent->max[1], there),
                      offsets(boxes.min[2], boxes.max[2], parent->min[2], parent->max[2], there)};
    s.x = _mm256_castsi256_ps(_mm256_or_si256(_mm256_andnot_si256(low_bits, _mm256_castps_si256(s.x)), numbers));
    for (unsigned round = 0; round < rounds; round++) {
        s = exchange(s, 7);
        s = exchange(s, 6);
        s = exchange(s, 5);
        s = exchange(s, 3);
        s = exchange(s, 1);
        s = exchange(s, 2);
        s = exchange(s, 4);
    }
    __m256i found = _mm256_and_si256(_mm256_castps_si256(s.x), low_bits);
    __m128i words = _mm_packs_epi32(_mm256_castsi256_si128(found), _mm256_extracti128_si256(found, 1));
    _mm_storel_epi64((__m128i *)(void *)ret_children, _mm_packus_epi16(words, words));
}

void octants_assign_boxes(const struct box *parent, const struct box *const children[8], unsigned count,
                          unsigned rounds, bool avx2, uint8_t ret_children[8])
{
    (avx2 ? assign_avx2 : assign_plain)(parent, children, count, rounds, ret_children);
}

#else

bool octants_has_avx2(void)
{
    return false;
}

void octants_assign_boxes(const struct box *parent, const struct box *const children[8], unsigned count,
                          unsigned rounds, bool avx2, uint8_t ret_children[8])
{
    (void)avx2;
    assign_plain(parent, children, count, rounds, ret_children);
}

#endif
