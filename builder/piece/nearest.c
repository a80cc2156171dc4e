/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/nearest.h"

#include <string.h>

#include "builder/kernel/vec4.h"

/*
 * Coordinate of the padding: so far away that a box of magnitudes up to 2^40 is always nearer to another box, and so
 * near that areas stay finite.
 */
static const float far_away = 0x1p60f;

enum { CODE = 31 };

void nearest_pad(const struct nearest_boxes *boxes, uint32_t count)
{
    for (int axis = 0; axis < 3; axis++)
        for (int i = 1; i <= NEAREST_PAD; i++) {
            boxes->min[axis][-i] = boxes->max[axis][-i] = -far_away;
            boxes->min[axis][count + i - 1] = boxes->max[axis][count + i - 1] = far_away;
        }
}

struct box4 {
    vec4 min[3], max[3];
};

static inline struct box4 load4(const struct nearest_boxes *boxes, int64_t at)
{
    struct box4 box;
    for (int axis = 0; axis < 3; axis++) {
        box.min[axis] = *(const vec4_loose *)(boxes->min[axis] + at);
        box.max[axis] = *(const vec4_loose *)(boxes->max[axis] + at);
    }
    return box;
}

/* Returns the smaller ones of the best keys so far and the keys of the boxes `offset` places further on. */
static inline vec4_int closer4(vec4_int best, const struct box4 *own, const struct nearest_boxes *boxes, int64_t at,
                               int offset)
{
    struct box4 other = load4(boxes, at + offset);
    vec4 side[3];
    for (int axis = 0; axis < 3; axis++)
        side[axis] = vec4_max(own->max[axis], other.max[axis]) - vec4_min(own->min[axis], other.min[axis]);
    vec4 area = side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
    int32_t i = (int32_t)at;
    vec4_int indices = {i, i + 1, i + 2, i + 3};
    vec4_int key = ((vec4_int)area & ~CODE) | ((indices ^ (indices + offset)) & CODE), nearer = key < best;
    return (key & nearer) | (best & ~nearer);
}

void nearest_find_plain(const struct nearest_boxes *boxes, uint32_t count, uint32_t radius, int32_t *ret_keys)
{
    for (uint32_t i = 0; i < count; i += 4) {
        struct box4 own = load4(boxes, i);
        vec4_int best = {INT32_MAX, INT32_MAX, INT32_MAX, INT32_MAX};
        for (int offset = 1; offset <= (int)radius; offset++) {
            best = closer4(best, &own, boxes, i, offset);
            best = closer4(best, &own, boxes, i, -offset);
        }
        memcpy(ret_keys + i, &best, sizeof best);
    }
}

#if defined(__x86_64__)
#include <immintrin.h>

#define AVX2 __attribute__((target("avx2")))

struct box8 {
    __m256 min[3], max[3];
};

AVX2 static inline struct box8 load_boxes(const struct nearest_boxes *boxes, int64_t at)
{
    struct box8 box;
    for (int axis = 0; axis < 3; axis++) {
        box.min[axis] = _mm256_loadu_ps(boxes->min[axis] + at);
        box.max[axis] = _mm256_loadu_ps(boxes->max[axis] + at);
    }
    return box;
}

AVX2 static inline __m256i keys8(const struct box8 *own, const struct nearest_boxes *boxes, int64_t at, __m256i indices,
                                 int offset)
{
    const __m256i mask = _mm256_set1_epi32(CODE);
    struct box8 other = load_boxes(boxes, at + offset);
    __m256 side[3];
    for (int axis = 0; axis < 3; axis++)
        side[axis] = _mm256_sub_ps(_mm256_max_ps(own->max[axis], other.max[axis]),
                                   _mm256_min_ps(own->min[axis], other.min[axis]));
    __m256 area = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(side[0], side[1]), _mm256_mul_ps(side[1], side[2])),
                                _mm256_mul_ps(side[2], side[0]));
    __m256i code = _mm256_xor_si256(indices, _mm256_add_epi32(indices, _mm256_set1_epi32(offset)));
    return _mm256_or_si256(_mm256_andnot_si256(mask, _mm256_castps_si256(area)), _mm256_and_si256(mask, code));
}

AVX2 static void find_avx2(const struct nearest_boxes *boxes, uint32_t count, uint32_t radius, int32_t *ret_keys)
{
    __m256i indices = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    for (uint32_t i = 0; i < count; i += 8) {
        struct box8 own = load_boxes(boxes, i);
        __m256i best = _mm256_set1_epi32(INT32_MAX);
        for (int offset = 1; offset <= (int)radius; offset++) {
            best = _mm256_min_epi32(best, keys8(&own, boxes, i, indices, offset));
            best = _mm256_min_epi32(best, keys8(&own, boxes, i, indices, -offset));
        }
        _mm256_storeu_si256((__m256i *)(void *)(ret_keys + i), best);
        indices = _mm256_add_epi32(indices, _mm256_set1_epi32(8));
    }
}

nearest_finder nearest_find_avx2(void)
{
    return __builtin_cpu_supports("avx2") ? find_avx2 : NULL;
}

#else

nearest_finder nearest_find_avx2(void)
{
    return NULL;
}

#endif

void nearest_find(const struct nearest_boxes *boxes, uint32_t count, uint32_t radius, int32_t *ret_keys)
{
    nearest_finder best = nearest_find_avx2();
    (best ? best : nearest_find_plain)(boxes, count, radius, ret_keys);
}
