/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/triangles_refs.h"

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
    finding.kept = (keep_all || !(infinite || finding.degenerate)) && !canonical_is_transparent(geometry, index);
    return finding;
}

/*
 * Looks at a triangle, or at one end of one that moves, to recognise the usual triangle quickly: it is finite, and one
 * component of the cross product of its edges exceeds the rounding error of floats by so much that it is not zero in
 * double either. All other triangles are classified by triangles_refs_look. The box is the same as there, except for
 * the sign of zeros.
 */
struct look {
    bool is_finite, has_area;
    struct vec4_box box;
};

static inline struct look look_at(const float *a, const float *b, const float *c)
{
    vec4 p = vec4_load3(a), q = vec4_load3(b), r = vec4_load3(c);
    vec4 u = q - p, v = r - p;
    vec4 left = u * vec4_rotate(v), right = vec4_rotate(u) * v;
    vec4 cross = vec4_abs(left - right);
    vec4 bound = vec4_max((vec4_abs(left) + vec4_abs(right)) * 1e-6f, vec4_all(1e-30f));
    return (struct look){
        .is_finite = vec4_bits((u + v) * 0.0f == vec4_all(0)) == 15,
        .has_area = (vec4_bits(cross > bound) & 7) != 0,
        .box = {vec4_min(r, vec4_min(q, p)), vec4_max(r, vec4_max(q, p))},
    };
}

/* The places of a triangle's corners in the array of positions. */
struct corners {
    uint64_t a, b, c;
};

static inline struct corners corners_of(const struct canonical_geometry *geometry, uint32_t index)
{
    const uint64_t at = (uint64_t)3 * index;
    const uint32_t *v = geometry->indices ? geometry->indices + at : NULL;
    if (!v)
        return (struct corners){3 * at, 3 * at + 3, 3 * at + 6};
    return (struct corners){(uint64_t)3 * v[0], (uint64_t)3 * v[1], (uint64_t)3 * v[2]};
}

static inline struct look look_at_key(const struct canonical_geometry *geometry, struct corners corners, int key)
{
    const float *positions = canonical_positions(geometry, key);
    return look_at(positions + corners.a, positions + corners.b, positions + corners.c);
}

static bool fast_ref(const struct canonical_geometry *geometry, uint32_t index, struct primitive_ref *ref)
{
    const struct look look = look_at_key(geometry, corners_of(geometry, index), 0);
    if (!(look.is_finite && look.has_area))
        return false;
    vec4_box_store(ref, look.box);
    return true;
}

/*
 * Makes the ref of a motion triangle. It is degenerate only if it has no area at both ends: a triangle that has an area
 * at one end can be hit at nearly every time.
 */
static bool fast_moving_ref(const struct canonical_geometry *geometry, uint32_t index, struct primitive_ref *ref)
{
    const struct corners corners = corners_of(geometry, index);
    const struct look start = look_at_key(geometry, corners, 0), end = look_at_key(geometry, corners, 1);
    struct vec4_box box = start.box;
    if (!(start.is_finite && end.is_finite && (start.has_area || end.has_area)))
        return false;
    vec4_box_grow(&box, end.box.min, end.box.max);
    vec4_box_store(ref, box);
    return true;
}

/* Infinite corners, which only ALLOW_UPDATE keeps, are clamped when all boxes have been added. */
void triangles_refs_grow_keys(const struct canonical_geometry *geometry, const uint32_t *ids, uint32_t count,
                              struct vec4_box *boxes)
{
    const vec4 most = vec4_all(FLT_MAX), least = vec4_all(-FLT_MAX);
    const float *start = geometry->positions, *end = canonical_positions(geometry, 1);
    struct vec4_box first = boxes[0], last = boxes[1];
    for (uint32_t i = 0; i < count; i++) {
        const struct corners at = corners_of(geometry, ids[i] - geometry->first_primitive);
        const vec4 p = vec4_load3(start + at.a), q = vec4_load3(start + at.b), r = vec4_load3(start + at.c);
        const vec4 u = vec4_load3(end + at.a), v = vec4_load3(end + at.b), w = vec4_load3(end + at.c);
        vec4_box_grow(&first, vec4_min(r, vec4_min(q, p)), vec4_max(r, vec4_max(q, p)));
        vec4_box_grow(&last, vec4_min(w, vec4_min(v, u)), vec4_max(w, vec4_max(v, u)));
    }
    boxes[0] = (struct vec4_box){vec4_max(first.min, least), vec4_min(first.max, most)};
    boxes[1] = (struct vec4_box){vec4_max(last.min, least), vec4_min(last.max, most)};
}

void triangles_refs_prefetch_keys(const struct canonical_geometry *geometry, uint32_t id, int step)
{
    const uint32_t index = id - geometry->first_primitive;
    if (step == 0 && geometry->indices) {
        __builtin_prefetch(geometry->indices + (uint64_t)3 * index);
        return;
    }
    const struct corners at = corners_of(geometry, index);
    for (int key = 0; key < 2; key++) {
        const float *positions = canonical_positions(geometry, key);
        __builtin_prefetch(positions + at.a);
        __builtin_prefetch(positions + at.b);
        __builtin_prefetch(positions + at.c);
    }
}

/*
 * Makes refs of consecutive usual triangles of one geometry, from `first` on, two at a time, with the same results as
 * fast_ref. Returns how many were made before the first unusual one.
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

/*
 * Returns bits 0 .. 2 for the components of the first one's cross product that are large enough, and 4 .. 6 for the
 * second one's; none if one of both is not finite.
 */
AVX2 static inline int areas_of_two(__m256 p, __m256 q, __m256 r)
{
    const __m256 sign = _mm256_set1_ps(-0.0f), zero = _mm256_setzero_ps();
    __m256 u = _mm256_sub_ps(q, p), v = _mm256_sub_ps(r, p);
    __m256 left = _mm256_mul_ps(u, rotate_two(v)), right = _mm256_mul_ps(rotate_two(u), v);
    __m256 cross = _mm256_andnot_ps(sign, _mm256_sub_ps(left, right));
    __m256 sum = _mm256_add_ps(_mm256_andnot_ps(sign, left), _mm256_andnot_ps(sign, right));
    __m256 bound = _mm256_max_ps(_mm256_mul_ps(sum, _mm256_set1_ps(1e-6f)), _mm256_set1_ps(1e-30f));
    int finite = _mm256_movemask_ps(_mm256_cmp_ps(_mm256_mul_ps(_mm256_add_ps(u, v), zero), zero, _CMP_EQ_OQ));
    int above = _mm256_movemask_ps(_mm256_cmp_ps(cross, bound, _CMP_GT_OQ));
    return finite == 0xff ? above : 0;
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
        const int areas = areas_of_two(p, q, r);
        if (!(areas & 0x07) || !(areas & 0x70))
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

/* The same for motion triangles, one at a time: both halves of a register are its two ends. */
AVX2 static uint32_t collect_ends_avx2(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                       struct primitive_ref *refs)
{
    const float *start = geometry->positions, *end = canonical_positions(geometry, 1);
    uint32_t made = 0;
    for (; made < count; made++) {
        const struct corners at = corners_of(geometry, first + made);
        __m256 p = load_two(start + at.a, end + at.a), q = load_two(start + at.b, end + at.b),
               r = load_two(start + at.c, end + at.c);
        if (!(areas_of_two(p, q, r) & 0x77))
            break;
        __m256 min = _mm256_min_ps(r, _mm256_min_ps(q, p)), max = _mm256_max_ps(r, _mm256_max_ps(q, p));
        __m128 least = _mm_min_ps(_mm256_extractf128_ps(min, 1), _mm256_castps256_ps128(min)),
               greatest = _mm_max_ps(_mm256_extractf128_ps(max, 1), _mm256_castps256_ps128(max));
        __m128i id = _mm_set1_epi32((int)(geometry->first_primitive + first + made));
        _mm_storeu_ps(refs[made].min, least); /* its fourth lane is zero, which is the ref's link */
        _mm_storeu_ps(refs[made].max, _mm_blend_ps(greatest, _mm_castsi128_ps(id), 8));
    }
    return made;
}

static uint32_t collect_pairs(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                              struct primitive_ref *refs)
{
    return __builtin_cpu_supports("avx2") ? collect_pairs_avx2(geometry, first, count, refs) : 0;
}

static uint32_t collect_ends(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                             struct primitive_ref *refs)
{
    return __builtin_cpu_supports("avx2") ? collect_ends_avx2(geometry, first, count, refs) : 0;
}

#else

static uint32_t collect_pairs(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                              struct primitive_ref *refs)
{
    (void)geometry, (void)first, (void)count, (void)refs;
    return 0;
}

static uint32_t collect_ends(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                             struct primitive_ref *refs)
{
    (void)geometry, (void)first, (void)count, (void)refs;
    return 0;
}

#endif

/* Counts a primitive that is not usual, and makes its ref if it is kept. Returns whether it is. */
static bool collect_unusual(classification_look look, const struct canonical *canonical,
                            const struct canonical_geometry *geometry, uint32_t index,
                            struct classification_counts *counts, struct primitive_ref *ref)
{
    struct classification finding = look(canonical, geometry, index);
    return classification_keep(&finding, geometry->first_primitive + index, counts, ref);
}

/* Numbers the ref of a usual primitive. */
static bool number(const struct canonical_geometry *geometry, uint32_t index, struct primitive_ref *ref)
{
    ref->link = 0;
    ref->id = geometry->first_primitive + index;
    return true;
}

uint32_t triangles_refs_collect(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                uint32_t first, uint32_t end, struct classification_counts *counts,
                                struct primitive_ref *refs)
{
    uint32_t kept = 0;
    if (geometry->resolves_micromaps)
        return classification_collect(triangles_refs_look, canonical, geometry, first, end, counts, refs);
    while (first < end) {
        uint32_t made = collect_pairs(geometry, first, end - first, refs + kept);
        kept += made;
        first += made;
        if (first == end)
            break;
        kept += fast_ref(geometry, first, &refs[kept])
                    ? number(geometry, first, &refs[kept])
                    : collect_unusual(triangles_refs_look, canonical, geometry, first, counts, &refs[kept]);
        first++;
    }
    return kept;
}

uint32_t triangles_refs_collect_moving(classification_look look, const struct canonical *canonical,
                                       const struct canonical_geometry *geometry, uint32_t first, uint32_t end,
                                       struct classification_counts *counts, struct primitive_ref *refs)
{
    uint32_t kept = 0;
    if (geometry->resolves_micromaps)
        return classification_collect(look, canonical, geometry, first, end, counts, refs);
    while (first < end) {
        uint32_t made = collect_ends(geometry, first, end - first, refs + kept);
        kept += made;
        first += made;
        if (first == end)
            break;
        kept += fast_moving_ref(geometry, first, &refs[kept])
                    ? number(geometry, first, &refs[kept])
                    : collect_unusual(look, canonical, geometry, first, counts, &refs[kept]);
        first++;
    }
    return kept;
}
