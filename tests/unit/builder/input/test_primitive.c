/* SPDX-License-Identifier: Apache-2.0 */
/* test_primitive.c - tests which primitives get refs, what their boxes are, and which ones share a ref. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/kernel/leaves.h"
#include "builder/input/primitive.h"
#include "tests/support/builder/test_ir.h"
#include "builder/workers.h"

/* Makes a view of triangles without indices. */
static struct canonical triangles_view(struct canonical_geometry *geometry, const float *positions, uint32_t count,
                                       uint32_t flags)
{
    *geometry = (struct canonical_geometry){
        .type = GEOMETRY_TRIANGLES, .primitive_count = count, .vertex_count = 3 * count, .positions = positions};
    return (struct canonical){.type = STRUCTURE_BOTTOM,
                              .flags = flags,
                              .geometry_count = 1,
                              .primitive_count = count,
                              .geometries = geometry};
}

/* Collects the refs and closes the gaps between blocks. */
static struct primitive_refs collect_with(const struct canonical *canonical, const struct leaves_options *runs,
                                          const struct build_context *context)
{
    struct primitive_refs refs;
    assert_int_equal(primitive_collect_blocks(canonical, runs, context, &refs, NULL), BVHD_OK);
    assert_true(primitive_close_gaps(&refs, context));
    assert_null(refs.blocks);
    return refs;
}

static struct primitive_refs collect(const struct canonical *canonical, struct memory *memory)
{
    const struct build_context context = {.memory = memory, .parallel = &parallel_serial};
    return collect_with(canonical, NULL, &context);
}

static void assert_counts(const struct primitive_refs *refs, uint32_t count, uint64_t inactive, uint64_t degenerate,
                          uint64_t skipped)
{
    assert_int_equal(refs->count, count);
    assert_int_equal(refs->inactive, inactive);
    assert_int_equal(refs->degenerate, degenerate);
    assert_int_equal(refs->skipped, skipped);
}

static void boxes_are_those_of_the_model(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int kind = 0; kind < 4; kind++) {
        struct test_shape shape = {.type = kind < 3 ? GEOMETRY_TRIANGLES : GEOMETRY_AABBS,
                                   .geometries = kind == 1 ? 700 : 3,
                                   .primitives = kind == 1 ? 30 : 7001,
                                   .size = 5,
                                   .detail = 0.01,
                                   .soup = kind == 2};
        struct test_model model;
        test_model_make(&shape, 1, &model);
        struct primitive_refs refs = collect(&model.canonical, &memory);
        struct box bounds = box_empty(), centroids = box_empty();
        uint32_t at = 0;
        for (uint32_t id = 0; id < model.canonical.primitive_count; id++) {
            const struct canonical_geometry *geometry = &model.canonical.geometries[id / shape.primitives];
            struct box box = primitive_box(&model.canonical, geometry, id % shape.primitives);
            if (box_is_empty(&box)) /* a triangle may have three equal indices */
                continue;
            const struct primitive_ref *ref = &refs.refs[at++];
            struct box own = primitive_ref_box(ref);
            assert_int_equal(ref->id, id);
            assert_int_equal(ref->link, 0);
            assert_memory_equal(&own, &model.boxes[id], sizeof own);
            assert_memory_equal(&own, &box, sizeof own);
            float centroid[3] = {own.min[0] + own.max[0], own.min[1] + own.max[1], own.min[2] + own.max[2]};
            box_grow(&bounds, &own);
            box_add_point(&centroids, centroid);
        }
        assert_int_equal(refs.count, at);
        assert_true(at > 20000);
        assert_memory_equal(&refs.bounds, &bounds, sizeof bounds);
        assert_memory_equal(&refs.centroids, &centroids, sizeof centroids);
        memory_free(&memory, refs.refs);
        test_model_finish(&model);
    }
    assert_int_equal(memory.live, 0);
}

/*
 * A triangle with a NaN anywhere is inactive. Without area, or with an infinite corner, it is left out, or kept for
 * updates with a finite box.
 */
static void special_triangles(void **state)
{
    (void)state;
    const float nan = NAN, inf = INFINITY, tiny = 1e-45f;
    const float positions[][9] = {
        {0, 0, 0, 1, 0, 0, 0, 1, 0}, /* ordinary */
        {0, nan, 0, 1, 0, 0, 0, 1, 0},
        {0, 0, 0, 1, 0, 0, 0, 1, nan},
        {inf, 0, 0, nan, 0, 0, 0, 1, 0},
        {0, 0, 0, inf, 0, 0, 0, 1, 0},
        {0, 0, 0, 1, 0, -inf, 0, 1, 0},
        {2, 2, 2, 2, 2, 2, 2, 2, 2}, /* a point */
        {0, 0, 0, 1, 1, 1, 3, 3, 3}, /* a line */
        {0, 0, 0, 0.1f, 0.2f, 0.3f, 0.2f, 0.4f, 0.6f}, /* a line when computed in floats */
        {tiny, 0, 0, 0, tiny, 0, 0, 0, tiny}, /* very small, but with an area */
        {-3e38f, -3e38f, 0, 3e38f, -3e38f, 0, 0, 3e38f, 1}, /* very large, but finite */
        {0, 0, 0, 1, 0, 0, 1, 1e-30f, 0}, /* a sliver */
        {1e6f, 1e6f, 1e6f, 1e6f + 1, 1e6f, 1e6f, 1e6f + 1, 1e6f + 0.0625f, 1e6f},
    };
    enum { COUNT = sizeof positions / sizeof *positions };
    struct memory memory;
    struct canonical_geometry geometry;
    memory_init(&memory, UINT64_MAX);
    struct canonical canonical = triangles_view(&geometry, positions[0], COUNT, 0);
    struct primitive_refs refs = collect(&canonical, &memory);
    assert_counts(&refs, 5, 3, 3, 5);
    static const uint32_t kept[5] = {0, 9, 10, 11, 12};
    for (int i = 0; i < 5; i++)
        assert_int_equal(refs.refs[i].id, kept[i]);
    memory_free(&memory, refs.refs);
    canonical.flags = BUILD_ALLOW_UPDATE;
    refs = collect(&canonical, &memory);
    assert_counts(&refs, COUNT - 3, 3, 3, 0);
    for (uint32_t i = 0; i < refs.count; i++)
        for (int axis = 0; axis < 3; axis++)
            assert_true(fabsf(refs.refs[i].min[axis]) <= FLT_MAX && fabsf(refs.refs[i].max[axis]) <= FLT_MAX);
    assert_true(refs.refs[1].max[0] == FLT_MAX && refs.refs[2].min[2] == -FLT_MAX);
    memory_free(&memory, refs.refs);
    assert_int_equal(memory.live, 0);
}

/*
 * Makes triangles that are nearly or exactly flat, and computes their cross products in double: those with an area are
 * kept.
 */
static void flat_triangles_by_double(void **state)
{
    (void)state;
    struct random random = {3};
    struct canonical_geometry geometry;
    uint32_t flat = 0;
    for (int round = 0; round < 20000; round++) {
        float p[9];
        double scale = ldexp(1, (int)random_between(&random, -60, 60));
        for (int k = 0; k < 6; k++)
            p[k] = (float)(round % 2 ? random_between(&random, -1, 1) * scale : floor(random_between(&random, -9, 9)));
        double weight = round % 2 ? random_between(&random, -2, 2) : floor(random_between(&random, -3, 3));
        for (int k = 0; k < 3; k++)
            p[6 + k] = (float)(p[k] + weight * (p[3 + k] - p[k]));
        struct canonical canonical = triangles_view(&geometry, p, 1, 0);
        struct box box = primitive_box(&canonical, &geometry, 0);
        double a[3], b[3];
        for (int k = 0; k < 3; k++) {
            a[k] = (double)p[3 + k] - p[k];
            b[k] = (double)p[6 + k] - p[k];
        }
        double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
        assert_int_equal(box_is_empty(&box), x == 0 && y == 0 && z == 0);
        struct memory memory;
        memory_init(&memory, UINT64_MAX);
        struct primitive_refs refs = collect(&canonical, &memory);
        assert_int_equal(refs.count, !box_is_empty(&box));
        memory_free(&memory, refs.refs);
        flat += box_is_empty(&box);
    }
    assert_true(flat > 5000 && flat < 15000);
}

static void special_boxes(void **state)
{
    (void)state;
    const float boxes[][6] = {
        {0, 1, 2, 3, 4, 5},
        {NAN, 0, 0, 1, 1, 1},
        {0, 0, 0, 1, NAN, 1},
        {7, 7, 7, 7, 7, 7},
        {-INFINITY, 0, 0, INFINITY, 1, 1},
    };
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct canonical_geometry geometry = {
        .type = GEOMETRY_AABBS, .primitive_count = 5, .first_primitive = 0, .boxes = boxes[0]};
    struct canonical canonical = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 5, .geometries = &geometry};
    struct primitive_refs refs = collect(&canonical, &memory);
    assert_counts(&refs, 3, 2, 1, 0);
    assert_int_equal(refs.refs[1].id, 3);
    assert_true(refs.refs[2].min[0] == -FLT_MAX && refs.refs[2].max[0] == FLT_MAX && refs.refs[2].max[1] == 1);
    memory_free(&memory, refs.refs);
    assert_int_equal(memory.live, 0);
}

static void put_instance(unsigned char *record, const float matrix[12], uint64_t reference)
{
    memset(record, 0, 64);
    memcpy(record, matrix, 48);
    memcpy(record + 56, &reference, 8);
}

/* The box contains all corners of the bounds, transformed in long double, and is at most a few ulp larger. */
static void instance_boxes_hold_all_corners(void **state)
{
    (void)state;
    struct random random = {11};
    unsigned char record[64];
    struct canonical_reference reference = {.kind = REFERENCE_BLAS};
    struct canonical_geometry geometry = {.type = GEOMETRY_INSTANCES, .primitive_count = 1, .instances = record};
    struct canonical canonical = {.type = STRUCTURE_TOP,
                                  .geometry_count = 1,
                                  .reference_count = 1,
                                  .primitive_count = 1,
                                  .geometries = &geometry,
                                  .references = &reference};
    for (int round = 0; round < 5000; round++) {
        float matrix[12];
        for (int k = 0; k < 12; k++)
            matrix[k] = (float)(random_between(&random, -1, 1) * ldexp(1, (int)random_between(&random, -10, 10)));
        reference.bounds = box_empty();
        for (int k = 0; k < 2; k++) {
            float point[3];
            for (int axis = 0; axis < 3; axis++)
                point[axis] = (float)(random_between(&random, -1, 1) * ldexp(1, (int)random_between(&random, -10, 10)));
            box_add_point(&reference.bounds, point);
        }
        put_instance(record, matrix, 1);
        struct box box = primitive_box(&canonical, &geometry, 0);
        for (int row = 0; row < 3; row++) {
            long double low = INFINITY, high = -INFINITY, size = fabsf(matrix[4 * row + 3]);
            for (int corner = 0; corner < 8; corner++) {
                long double value = matrix[4 * row + 3];
                for (int axis = 0; axis < 3; axis++)
                    value += (long double)matrix[4 * row + axis] *
                             (corner >> axis & 1 ? reference.bounds.max[axis] : reference.bounds.min[axis]);
                low = value < low ? value : low;
                high = value > high ? value : high;
            }
            for (int axis = 0; axis < 3; axis++)
                size += fabsl((long double)matrix[4 * row + axis] *
                              fmaxf(fabsf(reference.bounds.min[axis]), fabsf(reference.bounds.max[axis])));
            assert_true(box.min[row] <= low && box.max[row] >= high);
            assert_true(low - box.min[row] <= size * 0x1p-22L && box.max[row] - high <= size * 0x1p-22L);
        }
    }
}

static void special_instances(void **state)
{
    (void)state;
    static const float plain[12] = {1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7};
    unsigned char records[6][64];
    float nowhere[12], away[12], huge[12];
    memcpy(nowhere, plain, sizeof plain);
    memcpy(away, plain, sizeof plain);
    memcpy(huge, plain, sizeof plain);
    nowhere[3] = NAN;
    away[7] = INFINITY;
    huge[0] = 3e38f;
    put_instance(records[0], plain, 1);
    put_instance(records[1], plain, 0);
    put_instance(records[2], plain, 2);
    put_instance(records[3], nowhere, 1);
    put_instance(records[4], away, 1);
    put_instance(records[5], huge, 1);
    struct canonical_reference references[2] = {{.bounds = {{-2, -2, -2}, {2, 2, 2}}}, {.bounds = box_empty()}};
    struct canonical_geometry geometry = {.type = GEOMETRY_INSTANCES, .primitive_count = 6, .instances = records[0]};
    struct canonical canonical = {.type = STRUCTURE_TOP,
                                  .geometry_count = 1,
                                  .reference_count = 2,
                                  .primitive_count = 6,
                                  .geometries = &geometry,
                                  .references = references};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct primitive_refs refs = collect(&canonical, &memory);
    assert_counts(&refs, 2, 2, 1, 2);
    assert_int_equal(refs.refs[0].id, 0);
    assert_true(refs.refs[0].min[0] <= 3 && refs.refs[0].max[2] >= 9);
    assert_int_equal(refs.refs[1].id, 5);
    assert_true(refs.refs[1].min[0] == -FLT_MAX && refs.refs[1].max[0] == FLT_MAX);
    memory_free(&memory, refs.refs);
    canonical.flags = BUILD_ALLOW_UPDATE;
    refs = collect(&canonical, &memory);
    assert_counts(&refs, 4, 2, 1, 0);
    /* An instance of an empty structure keeps its position. */
    assert_true(refs.refs[1].min[0] <= 5 && refs.refs[1].max[0] >= 5 && refs.refs[1].max[0] < 5.0001f);
    memory_free(&memory, refs.refs);
    assert_int_equal(memory.live, 0);
}

/* Most chunks have gaps to close. */
static void threads_do_not_matter(void **state)
{
    (void)state;
    enum { COUNT = 50000 };
    struct random random = {5};
    float *positions = malloc(COUNT * 9 * sizeof *positions);
    assert_non_null(positions);
    uint32_t expected = 0;
    for (uint32_t i = 0; i < COUNT; i++) {
        bool out = random_next(&random) % 5 == 0 || (i > 20000 && i < 40000);
        for (int k = 0; k < 9; k++)
            positions[9 * i + k] = out && k == 4 ? NAN : (float)random_between(&random, -1, 1);
        expected += !out;
    }
    struct memory memory;
    struct canonical_geometry geometry;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = {.memory = &memory};
    struct canonical canonical = triangles_view(&geometry, positions, COUNT, 0);
    struct primitive_refs refs = collect(&canonical, &memory), other;
    assert_counts(&refs, expected, COUNT - expected, 0, 0);
    for (uint32_t i = 1; i < refs.count; i++)
        assert_true(refs.refs[i - 1].id < refs.refs[i].id);
    for (unsigned threads = 2; threads <= 8; threads *= 2) {
        struct workers *workers;
        assert_int_equal(workers_create(threads, &workers, NULL), BVHD_OK);
        context.parallel = workers_parallel(workers);
        other = collect_with(&canonical, NULL, &context);
        assert_int_equal(other.count, refs.count);
        assert_memory_equal(other.refs, refs.refs, refs.count * sizeof *refs.refs);
        assert_memory_equal(&other.bounds, &refs.bounds, sizeof refs.bounds);
        memory_free(&memory, other.refs);
        workers_destroy(workers);
    }
    memory_free(&memory, refs.refs);
    context.parallel = &parallel_serial;
    for (int64_t n = 0; n < 3; n++) {
        memory.fail_after = n;
        assert_int_equal(primitive_collect_blocks(&canonical, NULL, &context, &other, NULL), BVHD_NO_MEMORY);
        assert_int_equal(memory.live, 0);
    }
    free(positions);
}

/* Makes a strip of quads, two triangles each, then triangles anywhere; one in the last chunk is inactive. */
static void runs_hold_what_follows_each_other(void **state)
{
    (void)state;
    enum { COUNT = 5000, STRIP = 3000, MISSING = 4900 };
    struct random random = {7};
    float *positions = malloc(COUNT * 9 * sizeof *positions);
    assert_non_null(positions);
    for (uint32_t i = 0; i < COUNT; i++) {
        static const float corners[2][9] = {{0, 0, 0, 1, 0, 0, 0, 1, 0}, {1, 1, 0, 1, 0, 0, 0, 1, 0}};
        for (int k = 0; k < 9; k++)
            positions[9 * i + k] = i < STRIP ? corners[i % 2][k] + (k % 3 == 0 ? (float)(i / 2) : 0)
                                             : (float)random_between(&random, -1000, 1000);
    }
    positions[9 * MISSING] = NAN;
    struct memory memory;
    struct canonical_geometry geometry;
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    struct canonical canonical = triangles_view(&geometry, positions, COUNT, 0);
    struct primitive_refs plain = collect(&canonical, &memory);
    struct primitive_refs runs = collect_with(&canonical, &(struct leaves_options){2, 1}, &context);
    assert_true(runs.count < COUNT - STRIP / 2 + 10 && runs.count > STRIP / 2);
    assert_int_equal(runs.primitives, plain.primitives);
    assert_int_equal(plain.primitives, COUNT - 1);
    assert_memory_equal(&runs.bounds, &plain.bounds, sizeof runs.bounds);
    uint32_t at = 0;
    for (uint32_t i = 0; i < runs.count; i++) {
        struct box box = box_empty(), own = primitive_ref_box(&runs.refs[i]);
        assert_true(runs.refs[i].link < 2);
        for (uint32_t k = 0; k <= runs.refs[i].link; k++, at++) {
            struct box other = primitive_ref_box(&plain.refs[at]);
            assert_int_equal(plain.refs[at].id, runs.refs[i].id + k);
            box_grow(&box, &other);
        }
        assert_memory_equal(&box, &own, sizeof box);
    }
    assert_int_equal(at, plain.count);
    memory_free(&memory, plain.refs);
    memory_free(&memory, runs.refs);
    assert_int_equal(memory.live, 0);
    free(positions);
}

static void nothing_to_collect(void **state)
{
    (void)state;
    struct memory memory;
    struct canonical_geometry geometry;
    static const float positions[9] = {NAN};
    memory_init(&memory, UINT64_MAX);
    for (uint32_t count = 0; count < 2; count++) {
        struct canonical canonical = triangles_view(&geometry, positions, count, 0);
        canonical.geometry_count = count;
        struct primitive_refs refs = collect(&canonical, &memory);
        assert_counts(&refs, 0, count, 0, 0);
        assert_null(refs.refs);
        assert_true(box_is_empty(&refs.bounds));
    }
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_are_those_of_the_model),
        cmocka_unit_test(special_triangles),
        cmocka_unit_test(flat_triangles_by_double),
        cmocka_unit_test(special_boxes),
        cmocka_unit_test(instance_boxes_hold_all_corners),
        cmocka_unit_test(special_instances),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(runs_hold_what_follows_each_other),
        cmocka_unit_test(nothing_to_collect),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
