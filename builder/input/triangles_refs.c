/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/triangles_refs.h"

#include "builder/kernel/vec4.h"

static bool has_no_area(const float corners[3][3])
{
    double a[3], b[3];
    for (int axis = 0; axis < 3; axis++) {
        a[axis] = (double)corners[1][axis] - corners[0][axis];
        b[axis] = (double)corners[2][axis] - corners[0][axis];
    }
    return a[1] * b[2] == a[2] * b[1] && a[2] * b[0] == a[0] * b[2] && a[0] * b[1] == a[1] * b[0];
}

struct classification triangles_refs_look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                          uint32_t index)
{
    bool keep_all = canonical->flags & BUILD_ALLOW_UPDATE;
    struct classification finding = {.box = box_empty()};
    float corners[3][3];
    canonical_triangle(geometry, index, corners);
    if (classification_has_nan(corners[0], 9))
        return finding;
    finding.active = true;
    bool infinite = classification_has_infinity(corners[0], 9);
    for (int k = 0; k < 3; k++) {
        for (int axis = 0; axis < 3; axis++)
            corners[k][axis] = classification_clamp(corners[k][axis]);
        box_add_point(&finding.box, corners[k]);
    }
    finding.degenerate = !infinite && has_no_area((const float(*)[3])corners);
    finding.kept = keep_all || !(infinite || finding.degenerate);
    return finding;
}

/*
 * Recognises the usual triangle quickly: it is finite, and one component of the cross product of its edges exceeds the
 * rounding error of floats by so much that it is not zero in double either. All other triangles are classified by
 * triangles_refs_look. The box is the same as there, except for the sign of zeros.
 */
static inline bool plain_triangle(const float *a, const float *b, const float *c, struct vec4_box *ret_box)
{
    vec4 p = vec4_load3(a), q = vec4_load3(b), r = vec4_load3(c);
    vec4 u = q - p, v = r - p;
    vec4 left = u * vec4_rotate(v), right = vec4_rotate(u) * v;
    vec4 cross = vec4_abs(left - right);
    vec4 bound = vec4_max((vec4_abs(left) + vec4_abs(right)) * 1e-6f, vec4_all(1e-30f));
    *ret_box = (struct vec4_box){vec4_min(r, vec4_min(q, p)), vec4_max(r, vec4_max(q, p))};
    unsigned finite = vec4_bits((u + v) * 0.0f == vec4_all(0));
    return finite == 15 && (vec4_bits(cross > bound) & 7);
}

static bool fast_ref(const struct canonical_geometry *geometry, uint32_t index, struct primitive_ref *ref)
{
    uint64_t at = (uint64_t)3 * index;
    const float *p = geometry->positions;
    const uint32_t *v = geometry->indices ? geometry->indices + at : NULL;
    uint64_t a = v ? v[0] : at, b = v ? v[1] : at + 1, c = v ? v[2] : at + 2;
    struct vec4_box box;
    if (!plain_triangle(p + 3 * a, p + 3 * b, p + 3 * c, &box))
        return false;
    vec4_box_store(ref, box);
    return true;
}

/*
 * Makes refs of consecutive usual triangles of one geometry, from `first` on, two at a time, with the same results as
 * plain_triangle. Returns how many were made before the first unusual one.
 */
#if defined(__x86_64__)
#include <immintrin.h>

#define AVX2 __attribute__((target("avx2")))

AVX2 static inline __m256 load_two(const float *a, const float *b)
{
    return _mm256_insertf128_ps(_mm256_castps128_ps256(vec4_load3(a)), vec4_load3(b), 1);
}

AVX2 static inline __m256 rotate_two(__m256 v)
{
    return _mm256_permute_ps(v, _MM_SHUFFLE(3, 0, 2, 1));
}

AVX2 static inline bool two_plain_triangles(__m256 p, __m256 q, __m256 r)
{
    const __m256 sign = _mm256_set1_ps(-0.0f), zero = _mm256_setzero_ps();
    __m256 u = _mm256_sub_ps(q, p), v = _mm256_sub_ps(r, p);
    __m256 left = _mm256_mul_ps(u, rotate_two(v)), right = _mm256_mul_ps(rotate_two(u), v);
    __m256 cross = _mm256_andnot_ps(sign, _mm256_sub_ps(left, right));
    __m256 sum = _mm256_add_ps(_mm256_andnot_ps(sign, left), _mm256_andnot_ps(sign, right));
    __m256 bound = _mm256_max_ps(_mm256_mul_ps(sum, _mm256_set1_ps(1e-6f)), _mm256_set1_ps(1e-30f));
    int finite = _mm256_movemask_ps(_mm256_cmp_ps(_mm256_mul_ps(_mm256_add_ps(u, v), zero), zero, _CMP_EQ_OQ));
    int above = _mm256_movemask_ps(_mm256_cmp_ps(cross, bound, _CMP_GT_OQ));
    return finite == 0xff && (above & 0x07) && (above & 0x70);
}

AVX2 static uint32_t collect_pairs_avx2(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                        struct primitive_ref *refs)
{
    const float *positions = geometry->positions;
    const uint32_t *indices = geometry->indices ? geometry->indices + (uint64_t)3 * first : NULL;
    uint32_t made = 0;
    for (; made + 2 <= count; made += 2) {
        uint64_t corners[6];
        for (uint32_t k = 0; k < 6; k++)
            corners[k] = 3 * (indices ? indices[(uint64_t)3 * made + k] : (uint64_t)3 * (first + made) + k);
        __m256 p = load_two(positions + corners[0], positions + corners[3]);
        __m256 q = load_two(positions + corners[1], positions + corners[4]);
        __m256 r = load_two(positions + corners[2], positions + corners[5]);
        if (!two_plain_triangles(p, q, r))
            break;
        int id = (int)(geometry->first_primitive + first + made);
        __m256 ids = _mm256_castsi256_ps(_mm256_setr_epi32(0, 0, 0, id, 0, 0, 0, id + 1));
        __m256 min = _mm256_min_ps(r, _mm256_min_ps(q, p)), max = _mm256_max_ps(r, _mm256_max_ps(q, p));
        max = _mm256_blend_ps(max, ids, 0x88); /* the fourth lane of the minimum is zero, which is the ref's link */
        _mm256_storeu_ps(refs[made].min, _mm256_permute2f128_ps(min, max, 0x20));
        _mm256_storeu_ps(refs[made + 1].min, _mm256_permute2f128_ps(min, max, 0x31));
    }
    return made;
}

static uint32_t collect_pairs(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                              struct primitive_ref *refs)
{
    return __builtin_cpu_supports("avx2") ? collect_pairs_avx2(geometry, first, count, refs) : 0;
}

#else

static uint32_t collect_pairs(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                              struct primitive_ref *refs)
{
    (void)geometry, (void)first, (void)count, (void)refs;
    return 0;
}

#endif

/* Makes the ref of one primitive, and counts it. Returns whether it is kept. */
static bool collect_one(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t index,
                        struct classification_counts *counts, struct primitive_ref *ref)
{
    uint32_t id = geometry->first_primitive + index;
    if (!fast_ref(geometry, index, ref)) {
        struct classification finding = triangles_refs_look(canonical, geometry, index);
        return classification_keep(&finding, id, counts, ref);
    }
    ref->link = 0;
    ref->id = id;
    return true;
}

uint32_t triangles_refs_collect(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                uint32_t first, uint32_t end, struct classification_counts *counts,
                                struct primitive_ref *refs)
{
    uint32_t kept = 0;
    while (first < end) {
        uint32_t made = collect_pairs(geometry, first, end - first, refs + kept);
        kept += made;
        first += made;
        if (first < end)
            kept += collect_one(canonical, geometry, first++, counts, &refs[kept]);
    }
    return kept;
}
