/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/kernel/bins_kernels.h"

#include <math.h>

#define ALWAYS_INLINE static inline __attribute__((always_inline))

/* The fourth lanes hold integers, which may look like denormals and be slow to multiply, so they are cleared. */
ALWAYS_INLINE vec4 place(const struct bins_mapping *mapping, vec4 centroid)
{
    return vec4_xyz(centroid - mapping->base) * mapping->scale;
}

ALWAYS_INLINE vec4_int bin_of(const struct bins_mapping *mapping, vec4 last, vec4 centroid)
{
    return __builtin_convertvector(vec4_min(place(mapping, centroid), last), vec4_int);
}

static void clear_plain(struct bins *bins, const struct bins_mapping *mapping)
{
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t bin = 0; bin < mapping->bins; bin++)
            bins->boxes[axis][bin] = (struct vec4_box){vec4_all(FLT_MAX), vec4_all(FLT_MAX)};
    memset(bins->counts, 0, mapping->bins * sizeof *bins->counts);
}

static void add_plain(struct bins *const sets[2], const struct bins_mapping *mapping, const struct primitive_ref *refs,
                      uint32_t count)
{
    const struct bins_mapping local = *mapping;
    const vec4 last = vec4_all((float)(local.bins - 1));
    for (uint32_t i = 0; i < count; i++) {
        struct bins *set = sets[i & 1];
        struct vec4_box box = vec4_box_load(&refs[i]);
        vec4_int bin = bin_of(&local, last, box.min + box.max);
        vec4 negated = -box.max;
        for (int axis = 0; axis < 3; axis++) {
            struct vec4_box *own = &set->boxes[axis][bin[axis]];
            own->min = vec4_min(box.min, own->min);
            own->max = vec4_min(negated, own->max);
            set->counts[bin[axis]][axis]++;
        }
    }
}

/* Returns 1 when the ref goes left, else 0. */
ALWAYS_INLINE int32_t goes_left(const struct bins_mapping *mapping, vec4 threshold, vec4 centroid)
{
    return vec4_bits(place(mapping, centroid) < threshold) != 0;
}

/* Returns a vector that is the plane on its axis and below everything on the others. */
ALWAYS_INLINE vec4 threshold_of(const struct bins_plane *plane)
{
    vec4 threshold = vec4_all(-INFINITY);
    threshold[plane->axis] = (float)plane->bin;
    return threshold;
}

/*
 * Grows the box of the ref's side. For the other side the centroid becomes all ones, a NaN, which vec4_box_grow
 * ignores.
 */
ALWAYS_INLINE void grow_side(struct vec4_box sides[2], int32_t left, vec4 centroid)
{
    vec4_int to_left = {-left, -left, -left, -left};
    vec4 for_left = vec4_or(centroid, ~to_left), for_right = vec4_or(centroid, to_left);
    vec4_box_grow(&sides[0], for_left, for_left);
    vec4_box_grow(&sides[1], for_right, for_right);
}

static void partition_plain(const struct bins_mapping *mapping, const struct bins_plane *plane,
                            const struct primitive_ref *refs, uint32_t count, struct primitive_ref *left,
                            struct primitive_ref *right, struct vec4_box ret_centroids[2])
{
    const struct bins_mapping local = *mapping;
    const vec4 threshold = threshold_of(plane);
    struct vec4_box sides[2] = {vec4_box_empty(), vec4_box_empty()};
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]);
        vec4 centroid = box.min + box.max;
        int32_t is_left = goes_left(&local, threshold, centroid);
        vec4_box_store(is_left ? left : right, box);
        left += is_left;
        right += 1 - is_left;
        grow_side(sides, is_left, centroid);
    }
    ret_centroids[0] = sides[0];
    ret_centroids[1] = sides[1];
}

const struct bins_kernels bins_kernels_plain = {clear_plain, add_plain, partition_plain};

#if defined(__x86_64__)
#include <immintrin.h>

#define AVX2 __attribute__((target("avx2")))

AVX2 static void clear_avx2(struct bins *bins, const struct bins_mapping *mapping)
{
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t bin = 0; bin < mapping->bins; bin++)
            _mm256_store_ps((float *)&bins->boxes[axis][bin], _mm256_set1_ps(FLT_MAX));
    memset(bins->counts, 0, mapping->bins * sizeof *bins->counts);
}

AVX2 static inline __m256 load_ref(const struct primitive_ref *ref)
{
    return _mm256_loadu_ps((const float *)(const void *)ref);
}

AVX2 static inline void grow_avx2(struct bins *set, int axis, uint32_t bin, __m256 box)
{
    float *own = (float *)&set->boxes[axis][bin];
    _mm256_store_ps(own, _mm256_min_ps(box, _mm256_load_ps(own)));
    set->counts[bin][axis]++;
}

AVX2 static void add_avx2(struct bins *const sets[2], const struct bins_mapping *mapping,
                          const struct primitive_ref *refs, uint32_t count)
{
    const struct bins_mapping local = *mapping;
    const vec4 last = vec4_all((float)(local.bins - 1));
    const __m256 sign = _mm256_insertf128_ps(_mm256_setzero_ps(), _mm_set1_ps(-0.0f), 1);
    for (uint32_t i = 0; i < count; i++) {
        struct bins *set = sets[i & 1];
        __m256 ref = load_ref(&refs[i]);
        vec4_int bin = bin_of(&local, last, _mm256_castps256_ps128(ref) + _mm256_extractf128_ps(ref, 1));
        __m256 box = _mm256_xor_ps(ref, sign);
        grow_avx2(set, 0, (uint32_t)bin[0], box);
        grow_avx2(set, 1, (uint32_t)bin[1], box);
        grow_avx2(set, 2, (uint32_t)bin[2], box);
    }
}

AVX2 static void partition_avx2(const struct bins_mapping *mapping, const struct bins_plane *plane,
                                const struct primitive_ref *refs, uint32_t count, struct primitive_ref *left,
                                struct primitive_ref *right, struct vec4_box ret_centroids[2])
{
    const struct bins_mapping local = *mapping;
    const vec4 threshold = threshold_of(plane);
    struct vec4_box sides[2] = {vec4_box_empty(), vec4_box_empty()};
    for (uint32_t i = 0; i < count; i++) {
        __m256 ref = load_ref(&refs[i]);
        vec4 centroid = _mm256_castps256_ps128(ref) + _mm256_extractf128_ps(ref, 1);
        int32_t is_left = goes_left(&local, threshold, centroid);
        _mm256_storeu_ps((float *)(void *)(is_left ? left : right), ref);
        left += is_left;
        right += 1 - is_left;
        grow_side(sides, is_left, centroid);
    }
    ret_centroids[0] = sides[0];
    ret_centroids[1] = sides[1];
}

static const struct bins_kernels kernels_avx2 = {clear_avx2, add_avx2, partition_avx2};

const struct bins_kernels *bins_kernels_avx2(void)
{
    return __builtin_cpu_supports("avx2") ? &kernels_avx2 : NULL;
}

#else

const struct bins_kernels *bins_kernels_avx2(void)
{
    return NULL;
}

#endif
