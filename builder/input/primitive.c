/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/primitive.h"

#include <math.h>
#include <stddef.h>

#include "builder/kernel/leaves.h"
#include "builder/input/outline.h"
#include "builder/kernel/vec4.h"
#include "proto/base/round_outward.h"

/* Primitives whose refs stay in the first-level cache. One task handles the chunks of a whole block. */
enum { CHUNK = 1024 };

/* The classification of one primitive, and its box. */
struct classification {
    bool active, degenerate, kept;
    struct box box; /* if kept */
};

static float clamp_to_finite(float value)
{
    return value > FLT_MAX ? FLT_MAX : value < -FLT_MAX ? -FLT_MAX : value;
}

static bool any_nan(const float *values, int count)
{
    for (int i = 0; i < count; i++)
        if (isnan(values[i]))
            return true;
    return false;
}

static bool any_infinite(const float *values, int count)
{
    for (int i = 0; i < count; i++)
        if (isinf(values[i]))
            return true;
    return false;
}

static bool has_no_area(const float corners[3][3])
{
    double a[3], b[3];
    for (int axis = 0; axis < 3; axis++) {
        a[axis] = (double)corners[1][axis] - corners[0][axis];
        b[axis] = (double)corners[2][axis] - corners[0][axis];
    }
    return a[1] * b[2] == a[2] * b[1] && a[2] * b[0] == a[0] * b[2] && a[0] * b[1] == a[1] * b[0];
}

static struct classification look_at_triangle(const struct canonical_geometry *geometry, uint32_t index, bool keep_all)
{
    struct classification finding = {.box = box_empty()};
    float corners[3][3];
    canonical_triangle(geometry, index, corners);
    if (any_nan(corners[0], 9))
        return finding;
    finding.active = true;
    bool infinite = any_infinite(corners[0], 9);
    for (int k = 0; k < 3; k++) {
        for (int axis = 0; axis < 3; axis++)
            corners[k][axis] = clamp_to_finite(corners[k][axis]);
        box_add_point(&finding.box, corners[k]);
    }
    finding.degenerate = !infinite && has_no_area((const float(*)[3])corners);
    finding.kept = keep_all || !(infinite || finding.degenerate);
    return finding;
}

static struct classification look_at_aabb(const struct canonical_geometry *geometry, uint32_t index)
{
    struct classification finding = {.box = box_empty()};
    const float *box = geometry->boxes + (uint64_t)6 * index;
    if (any_nan(box, 6))
        return finding;
    finding.active = finding.kept = finding.degenerate = true;
    for (int axis = 0; axis < 3; axis++) {
        finding.box.min[axis] = clamp_to_finite(box[axis]);
        finding.box.max[axis] = clamp_to_finite(box[axis + 3]);
        finding.degenerate &= finding.box.min[axis] == finding.box.max[axis];
    }
    return finding;
}

/*
 * Transforms a box by its centre and half extent: c' = M c + t, e' = |M| e. `slack` bounds the rounding errors of these
 * few operations, relative to the sum of magnitudes.
 */
static void transform_box(const float matrix[12], const struct box *box, struct box *ret_box)
{
    for (int row = 0; row < 3; row++) {
        const float *m = matrix + 4 * row;
        double centre = m[3], extent = 0, magnitude = fabs((double)m[3]);
        for (int axis = 0; axis < 3; axis++) {
            double min = box->min[axis], max = box->max[axis];
            centre += m[axis] * (0.5 * (min + max));
            extent += fabs((double)m[axis]) * (0.5 * (max - min));
            magnitude += fabs((double)m[axis]) * (fabs(min) + fabs(max));
        }
        double slack = magnitude * 0x1p-48;
        ret_box->min[row] = clamp_to_finite(round_down(centre - extent - slack));
        ret_box->max[row] = clamp_to_finite(round_up(centre + extent + slack));
    }
}

static struct classification look_at_instance(const struct canonical *canonical,
                                              const struct canonical_geometry *geometry, uint32_t index, bool keep_all)
{
    struct classification finding = {.box = box_empty()};
    struct canonical_instance instance = canonical_instance(geometry, index);
    if (instance.reference == 0 || any_nan(instance.transform, 12))
        return finding;
    finding.active = true;
    const struct canonical_reference *reference = &canonical->references[instance.reference - 1];
    struct box bounds = reference->bounds;
    bool infinite = any_infinite(instance.transform, 12);
    finding.degenerate = box_is_empty(&bounds);
    finding.kept = keep_all || !(infinite || finding.degenerate);
    for (int k = 0; k < 12; k++)
        instance.transform[k] = clamp_to_finite(instance.transform[k]);
    for (int axis = 0; axis < 3; axis++) {
        bounds.min[axis] = finding.degenerate ? 0 : clamp_to_finite(bounds.min[axis]);
        bounds.max[axis] = finding.degenerate ? 0 : clamp_to_finite(bounds.max[axis]);
    }
    transform_box(instance.transform, &bounds, &finding.box);
    if (!(infinite || finding.degenerate || canonical->ignores_slabs))
        outline_narrow(instance.transform, &bounds, &reference->slabs, &finding.box);
    return finding;
}

static struct classification look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                  uint32_t index)
{
    bool keep_all = canonical->flags & BUILD_ALLOW_UPDATE;
    switch (geometry->type) {
    case GEOMETRY_TRIANGLES:
        return look_at_triangle(geometry, index, keep_all);
    case GEOMETRY_AABBS:
        return look_at_aabb(geometry, index);
    default:
        return look_at_instance(canonical, geometry, index, keep_all);
    }
}

struct box primitive_box(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t index)
{
    struct classification finding = look(canonical, geometry, index);
    return finding.kept ? finding.box : box_empty();
}

/*
 * Recognises the usual triangle quickly: it is finite, and one component of the cross product of its edges exceeds the
 * rounding error of floats by so much that it is not zero in double either. All other triangles are classified by
 * look_at_triangle. The box is the same as there, except for the sign of zeros.
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
    if (geometry->type != GEOMETRY_TRIANGLES)
        return false;
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
    bool able = geometry->type == GEOMETRY_TRIANGLES && __builtin_cpu_supports("avx2");
    return able ? collect_pairs_avx2(geometry, first, count, refs) : 0;
}

#else

static uint32_t collect_pairs(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                              struct primitive_ref *refs)
{
    (void)geometry, (void)first, (void)count, (void)refs;
    return 0;
}

#endif

/* The totals of one block. */
struct block_totals {
    uint32_t count, primitives;
    struct box bounds, centroids;
    uint64_t inactive, degenerate, skipped;
};

struct collection {
    const struct canonical *canonical;
    struct primitive_ref *refs;
    struct block_totals *blocks;
    size_t block_count, block_size;
    const struct leaves_options *runs; /* NULL: each ref stands for one primitive */
};

/* Makes the ref of one primitive, and counts it. Returns whether it is kept. */
static bool collect_one(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t index,
                        struct block_totals *block, struct primitive_ref *ref)
{
    if (!fast_ref(geometry, index, ref)) {
        struct classification finding = look(canonical, geometry, index);
        block->inactive += !finding.active;
        block->degenerate += finding.degenerate;
        block->skipped += finding.active && !finding.kept;
        if (!finding.kept)
            return false;
        memcpy(ref->min, finding.box.min, sizeof ref->min);
        memcpy(ref->max, finding.box.max, sizeof ref->max);
    }
    ref->link = 0;
    ref->id = geometry->first_primitive + index;
    return true;
}

/*
 * Joins neighbours in the request that would share a leaf into one ref. The numbers of a run's primitives are
 * consecutive, so the caller makes sure that none of them was left out.
 */
static uint32_t make_runs(struct primitive_ref *refs, uint32_t count, const struct leaves_options *options)
{
    uint8_t lengths[CHUNK];
    uint32_t runs = leaves_cut(refs, count, options, lengths);
    const struct primitive_ref *next = refs;
    for (uint32_t run = 0; run < runs; run++) {
        uint32_t id = next->id, length = lengths[run];
        vec4_box_store(&refs[run], leaves_box(next, length));
        refs[run].link = length - 1;
        refs[run].id = id;
        next += length;
    }
    return runs;
}

uint32_t primitive_block(uint32_t primitives)
{
    enum { LARGEST = 8192, ENOUGH = 64 };
    uint32_t block = LARGEST;
    while (block > CHUNK && primitives / block < ENOUGH)
        block /= 2;
    return block;
}

/* Makes refs of primitives [index, end) of one geometry, and returns how many are kept. */
static uint32_t collect_range(const struct canonical *canonical, const struct canonical_geometry *geometry,
                              uint32_t index, uint32_t end, struct block_totals *block, struct primitive_ref *refs)
{
    uint32_t kept = 0;
    while (index < end) {
        uint32_t made = collect_pairs(geometry, index, end - index, refs + kept);
        kept += made;
        index += made;
        if (index < end)
            kept += collect_one(canonical, geometry, index++, block, &refs[kept]);
    }
    return kept;
}

/* Adds the refs of primitives [id, end) to a block. */
static void collect_chunk(const struct collection *collection, size_t id, size_t end, struct primitive_ref *refs,
                          struct block_totals *block)
{
    const struct canonical *canonical = collection->canonical;
    const uint32_t asked = (uint32_t)(end - id);
    uint32_t count = 0;
    struct box bounds, centroids;
    while (id < end) {
        const struct canonical_geometry *geometry =
            &canonical->geometries[canonical_geometry_of(canonical, (uint32_t)id)];
        size_t last = (size_t)geometry->first_primitive + geometry->primitive_count;
        last = last < end ? last : end;
        count += collect_range(canonical, geometry, (uint32_t)(id - geometry->first_primitive),
                               (uint32_t)(last - geometry->first_primitive), block, &refs[count]);
        id = last;
    }
    block->primitives += count;
    if (collection->runs && collection->runs->leaf_max > 1 && count == asked)
        count = make_runs(refs, count, collection->runs);
    primitive_ref_bounds(refs, count, &bounds, &centroids);
    box_grow(&block->bounds, &bounds);
    box_grow(&block->centroids, &centroids);
    block->count += count;
}

static void collect_block(void *context, size_t index)
{
    const struct collection *collection = context;
    struct block_totals block = {.bounds = box_empty(), .centroids = box_empty()};
    size_t begin, end;
    parallel_chunk(index, collection->block_size, collection->canonical->primitive_count, &begin, &end);
    struct primitive_ref *refs = collection->refs + begin;
    for (size_t id = begin; id < end; id += CHUNK)
        collect_chunk(collection, id, end - id < CHUNK ? end : id + CHUNK, refs + block.count, &block);
    collection->blocks[index] = block;
}

/* Adds up the blocks in their order. */
static void combine(const struct collection *collection, struct primitive_refs *refs)
{
    refs->block_count = (uint32_t)collection->block_count;
    for (size_t i = 0; i < collection->block_count; i++) {
        const struct block_totals *block = &collection->blocks[i];
        refs->blocks[i] = block->count;
        refs->count += block->count;
        refs->primitives += block->primitives;
        refs->inactive += block->inactive;
        refs->degenerate += block->degenerate;
        refs->skipped += block->skipped;
        box_grow(&refs->bounds, &block->bounds);
        box_grow(&refs->centroids, &block->centroids);
    }
}

static enum bvhd_status collect(struct collection *collection, const struct build_context *context,
                                struct primitive_refs *refs)
{
    collection->refs = refs->refs =
        memory_array(context->memory, collection->canonical->primitive_count, sizeof *refs->refs);
    collection->blocks = memory_array(context->memory, collection->block_count, sizeof *collection->blocks);
    refs->blocks = memory_array(context->memory, collection->block_count, sizeof *refs->blocks);
    if (!collection->refs || !collection->blocks || !refs->blocks)
        return BVHD_NO_MEMORY;
    if (!parallel_for_until(context->parallel, context->cancel, collection->block_count, collect_block, collection))
        return BVHD_CANCELLED;
    combine(collection, refs);
    return BVHD_OK;
}

bool primitive_close_gaps(struct primitive_refs *refs, const struct build_context *context)
{
    for (uint32_t done = 0, i = 0; refs->blocks && done < refs->count; done += refs->blocks[i++]) {
        const struct primitive_ref *block = refs->refs + (uint64_t)i * refs->block_size;
        if (block != refs->refs + done)
            memmove(refs->refs + done, block, refs->blocks[i] * sizeof *block);
        if (parallel_cancelled(context->cancel))
            return false;
    }
    memory_free(context->memory, refs->blocks);
    refs->blocks = NULL;
    return true;
}

static void free_refs(struct primitive_refs *refs, struct memory *memory)
{
    memory_free(memory, refs->refs);
    memory_free(memory, refs->blocks);
    refs->refs = NULL;
    refs->blocks = NULL;
}

enum bvhd_status primitive_collect_blocks(const struct canonical *canonical, const struct leaves_options *runs,
                                          const struct build_context *context, struct primitive_refs *ret_refs,
                                          struct bvhd_error *error)
{
    struct collection collection = {.canonical = canonical, .runs = runs};
    struct primitive_refs refs = {.bounds = box_empty(), .centroids = box_empty()};
    enum bvhd_status status = BVHD_OK;
    collection.block_size = refs.block_size = primitive_block(canonical->primitive_count);
    collection.block_count = parallel_chunks(collection.block_size, canonical->primitive_count);
    if (collection.block_count > 0)
        status = collect(&collection, context, &refs);
    memory_free(context->memory, collection.blocks);
    if (status != BVHD_OK || refs.count == 0)
        free_refs(&refs, context->memory);
    if (status == BVHD_CANCELLED)
        return bvhd_error_set(error, status, "", "cancelled");
    if (status != BVHD_OK)
        return bvhd_error_set(error, status, "", "no memory for the boxes of %u primitives",
                              canonical->primitive_count);
    *ret_refs = refs;
    return BVHD_OK;
}
