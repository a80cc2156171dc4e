/* SPDX-License-Identifier: Apache-2.0 */
#include "bins_kernels.h"

#include <math.h>

#define ALWAYS_INLINE static inline __attribute__((always_inline))

/* The fourth lanes hold integers that may look like denormals, slow to multiply: they are cleared. */
ALWAYS_INLINE vec4 place(const struct bins_mapping *mapping, vec4 centroid)
{
    return vec4_xyz(centroid - mapping->base) * mapping->scale;
}

ALWAYS_INLINE vec4_int bin_of(const struct bins_mapping *mapping, vec4 last, vec4 centroid)
{
    return __builtin_convertvector(vec4_min(place(mapping, centroid), last), vec4_int);
}

static void add_plain(struct bins *const sets[2], const struct bins_mapping *mapping, const struct primitive_ref *refs, uint32_t count)
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

ALWAYS_INLINE void partition(const struct bins_mapping *mapping, const struct bins_plane *plane, const struct primitive_ref *refs,
                             uint32_t count, struct primitive_ref *left, struct primitive_ref *right, struct vec4_box ret_centroids[2])
{
    const struct bins_mapping local = *mapping;
    vec4 threshold = vec4_all(-INFINITY);
    threshold[plane->axis] = (float)plane->bin;
    struct vec4_box left_box = vec4_box_empty(), right_box = vec4_box_empty();
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]);
        vec4 centroid = box.min + box.max;
        int32_t goes_left = vec4_bits(place(&local, centroid) < threshold) != 0;
        vec4_box_store(goes_left ? left : right, box);
        left += goes_left;
        right += 1 - goes_left;
        /* All bits set make a NaN, which the boxes of the other side do not take. */
        vec4_int to_left = {-goes_left, -goes_left, -goes_left, -goes_left};
        vec4 for_left = vec4_or(centroid, ~to_left), for_right = vec4_or(centroid, to_left);
        vec4_box_grow(&left_box, for_left, for_left);
        vec4_box_grow(&right_box, for_right, for_right);
    }
    ret_centroids[0] = left_box;
    ret_centroids[1] = right_box;
}

static void partition_plain(const struct bins_mapping *mapping, const struct bins_plane *plane, const struct primitive_ref *refs,
                            uint32_t count, struct primitive_ref *left, struct primitive_ref *right, struct vec4_box ret_centroids[2])
{
    partition(mapping, plane, refs, count, left, right, ret_centroids);
}

const struct bins_kernels bins_kernels_plain = {add_plain, partition_plain};

#if defined(__x86_64__)
#include <immintrin.h>

#define AVX2 __attribute__((target("avx2")))

AVX2 static void grow_avx2(struct bins *set, int axis, uint32_t bin, __m256 box)
{
    float *own = (float *)&set->boxes[axis][bin];
    _mm256_store_ps(own, _mm256_min_ps(box, _mm256_load_ps(own)));
    set->counts[bin][axis]++;
}

AVX2 static void add_avx2(struct bins *const sets[2], const struct bins_mapping *mapping, const struct primitive_ref *refs,
                          uint32_t count)
{
    const struct bins_mapping local = *mapping;
    const vec4 last = vec4_all((float)(local.bins - 1));
    const __m256 sign = _mm256_insertf128_ps(_mm256_setzero_ps(), _mm_set1_ps(-0.0f), 1);
    for (uint32_t i = 0; i < count; i++) {
        struct bins *set = sets[i & 1];
        struct vec4_box box = vec4_box_load(&refs[i]);
        vec4_int bin = bin_of(&local, last, box.min + box.max);
        __m256 both = _mm256_xor_ps(_mm256_loadu_ps((const float *)(const void *)&refs[i]), sign);
        grow_avx2(set, 0, (uint32_t)bin[0], both);
        grow_avx2(set, 1, (uint32_t)bin[1], both);
        grow_avx2(set, 2, (uint32_t)bin[2], both);
    }
}

AVX2 static void partition_avx2(const struct bins_mapping *mapping, const struct bins_plane *plane, const struct primitive_ref *refs,
                                uint32_t count, struct primitive_ref *left, struct primitive_ref *right,
                                struct vec4_box ret_centroids[2])
{
    partition(mapping, plane, refs, count, left, right, ret_centroids);
}

static const struct bins_kernels kernels_avx2 = {add_avx2, partition_avx2};

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
