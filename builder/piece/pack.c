/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/pack.h"

#include <stdbool.h>
#include <string.h>

/* Packs without branches, because what is kept is unpredictable. */
static void pack_words(const void *from, const uint8_t *kept, uint32_t count, void *to)
{
    const unsigned char *word = from;
    unsigned char *next = to;
    for (uint32_t i = 0; i < count; i++, word += sizeof(uint32_t)) {
        memcpy(next, word, sizeof(uint32_t));
        next += sizeof(uint32_t) * kept[i];
    }
}

void pack_row_plain(const struct nearest_boxes *boxes, const uint32_t *nodes, const uint8_t *kept, uint32_t count,
                    const struct nearest_boxes *ret_boxes, uint32_t *ret_nodes)
{
    for (int axis = 0; axis < 3; axis++) {
        pack_words(boxes->min[axis], kept, count, ret_boxes->min[axis]);
        pack_words(boxes->max[axis], kept, count, ret_boxes->max[axis]);
    }
    pack_words(nodes, kept, count, ret_nodes);
}

#if defined(__x86_64__)
#include <immintrin.h>

#define AVX2 __attribute__((target("avx2,bmi2,popcnt")))

/* Returns the numbers of the bytes that are 1, lowest first. */
AVX2 static inline __m256i places_of(uint64_t bytes)
{
    return _mm256_cvtepu8_epi32(_mm_cvtsi64_si128((int64_t)_pext_u64(UINT64_C(0x0706050403020100), bytes * 0xff)));
}

AVX2 static inline void pack_floats(const float *from, __m256i places, float *to)
{
    _mm256_storeu_ps(to, _mm256_permutevar8x32_ps(_mm256_loadu_ps(from), places));
}

AVX2 static void pack_avx2(const struct nearest_boxes *boxes, const uint32_t *nodes, const uint8_t *kept,
                           uint32_t count, const struct nearest_boxes *ret_boxes, uint32_t *ret_nodes)
{
    const struct nearest_boxes from = *boxes, ret = *ret_boxes;
    uint32_t to = 0;
    for (uint32_t i = 0; i < count; i += 8) {
        uint64_t bytes;
        memcpy(&bytes, kept + i, sizeof bytes);
        const __m256i places = places_of(bytes);
        for (int axis = 0; axis < 3; axis++) {
            pack_floats(from.min[axis] + i, places, ret.min[axis] + to);
            pack_floats(from.max[axis] + i, places, ret.max[axis] + to);
        }
        __m256i own = _mm256_loadu_si256((const __m256i *)(const void *)(nodes + i));
        _mm256_storeu_si256((__m256i *)(void *)(ret_nodes + to), _mm256_permutevar8x32_epi32(own, places));
        to += (uint32_t)_mm_popcnt_u64(bytes);
    }
}

/* AMD's Zen 1 and Zen 2 have pext only in slow microcode, which costs more than it saves. */
static bool is_able(void)
{
    bool slow = __builtin_cpu_is("znver1") || __builtin_cpu_is("znver2");
    return !slow && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2") &&
           __builtin_cpu_supports("popcnt");
}

pack_packer pack_row_avx2(void)
{
    return is_able() ? pack_avx2 : NULL;
}

#else

pack_packer pack_row_avx2(void)
{
    return NULL;
}

#endif

void pack_row(const struct nearest_boxes *boxes, const uint32_t *nodes, const uint8_t *kept, uint32_t count,
              const struct nearest_boxes *ret_boxes, uint32_t *ret_nodes)
{
    pack_packer packer = pack_row_avx2();
    (packer ? packer : pack_row_plain)(boxes, nodes, kept, count, ret_boxes, ret_nodes);
}
