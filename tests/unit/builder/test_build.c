/* SPDX-License-Identifier: Apache-2.0 */
/* test_build.c - tests that build() gives sound trees and repeatable bytes, and survives failures and extremes. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/build.h"
#include "builder/kernel/clip.h"
#include "builder/format/portable.h"
#include "builder/input/primitive.h"
#include "proto/base/kind.h"
#include "tests/support/builder/builders.h"
#include "tests/support/builder/test_ir.h"
#include "builder/workers.h"

static const struct build_options balanced = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE};

static struct build_context context_over(struct memory *memory, const struct parallel *parallel)
{
    return (struct build_context){.memory = memory, .parallel = parallel};
}

static const struct test_shape soup = {
    .type = GEOMETRY_TRIANGLES, .geometries = 2, .primitives = 6000, .size = 10, .detail = 0.02};

static struct build_options options_for(enum build_builder builder, enum build_quality quality)
{
    return (struct build_options){.quality = quality, .target = TARGET_PORTABLE, .builder = builder};
}

static struct test_shape soup_of(uint32_t type)
{
    struct test_shape shape = soup;
    shape.type = type;
    shape.geometries = kind_find(type)->is_top ? 1 : kind_find(type)->moves ? 3 : 2;
    return shape;
}

/* The boxes of primitives, of both keys where something moves. */
static struct box *boxes_of(const struct canonical *canonical)
{
    const uint32_t count = canonical->primitive_count;
    struct box *boxes = calloc(2 * (size_t)count + 1, sizeof *boxes), keys[2];
    assert_non_null(boxes);
    for (uint32_t id = 0; id < count; id++) {
        const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
        primitive_key_boxes(canonical, geometry, id - geometry->first_primitive, keys);
        boxes[id] = keys[0];
        boxes[count + id] = keys[1];
    }
    return boxes;
}

/* Builds the binary tree and checks it against the primitives; the caller ends it. */
static struct ir sound_ir_by(enum build_builder builder, const struct canonical *canonical, enum build_quality quality,
                             const struct build_context *context, struct build_stats *stats)
{
    struct build_options options = options_for(builder, quality);
    struct ir ir;
    assert_int_equal(build_ir(canonical, &options, context, &ir, stats, NULL), BVHD_OK);
    struct box *boxes = boxes_of(canonical);
    assert_int_equal(ir.key_count, canonical_moves(canonical) && ir.node_count > 0 ? 2 : 1);
    bool split = strcmp(stats->method, "spatial") == 0 || strcmp(stats->method, "embree-high") == 0;
    assert_int_equal(ir_check(&ir, canonical->primitive_count, boxes, split, context->memory, NULL), BVHD_OK);
    assert_int_equal(stats->depth, ir_depth(&ir, context->memory));
    assert_true(fabs(stats->sah - ir_sah(&ir)) <= 1e-9 * stats->sah);
    assert_int_equal(stats->refs, ir.ref_count);
    for (uint32_t i = 0; i < ir.node_count; i++)
        assert_true(ir.nodes[i].count <= 3);
    free(boxes);
    return ir;
}

static struct ir sound_ir(const struct canonical *canonical, enum build_quality quality,
                          const struct build_context *context, struct build_stats *stats)
{
    return sound_ir_by(BUILDER_OWN, canonical, quality, context, stats);
}

static const uint32_t types[KIND_OF_RAYS] = {
    GEOMETRY_TRIANGLES,        GEOMETRY_AABBS,           GEOMETRY_INSTANCES, GEOMETRY_SPHERES, GEOMETRY_SWEPT_SPHERES,
    GEOMETRY_MOVING_TRIANGLES, GEOMETRY_MOVING_INSTANCES};

static void check_every_kind(enum build_builder builder)
{
    static const char *const methods[][QUALITY_HIGH + 1] = {
        [BUILDER_OWN] = {[QUALITY_FAST] = "ploc", [QUALITY_BALANCED] = "binned", [QUALITY_HIGH] = "spatial"},
        [BUILDER_EMBREE] = {
            [QUALITY_FAST] = "embree-low", [QUALITY_BALANCED] = "embree-medium", [QUALITY_HIGH] = "embree-high"}};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    for (int t = 0; t < KIND_OF_RAYS; t++)
        for (uint32_t count = 1; count < 3000; count = count * 6 + (count < 3))
            for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
                struct test_shape shape = soup_of(types[t]);
                struct test_model model;
                struct build_stats stats;
                shape.primitives = count;
                test_model_make(&shape, count, &model);
                for (uint32_t r = 0; r < model.canonical.reference_count; r++)
                    model.canonical.references[r].bounds = (struct box){{0, 0, 0}, {1, 1, 1}};
                struct ir ir = sound_ir_by(builder, &model.canonical, quality, &context, &stats);
                const bool cuts = builder ? types[t] == GEOMETRY_TRIANGLES : kind_find(types[t])->can_be_cut;
                const bool splits = cuts || quality != QUALITY_HIGH;
                if (stats.refs > 0)
                    assert_string_equal(stats.method, methods[builder][splits ? quality : QUALITY_BALANCED]);
                assert_int_equal(stats.primitives, model.canonical.primitive_count);
                const uint32_t type = kind_find(types[t])->vulkan_type;
                assert_int_equal(stats.triangles, type == GEOMETRY_TRIANGLES ? stats.primitives : 0);
                assert_int_equal(stats.instances, type == GEOMETRY_INSTANCES ? stats.primitives : 0);
                ir_finish(&ir);
                test_model_finish(&model);
            }
    assert_int_equal(memory.live, 0);
}

static void every_kind_of_primitive_and_quality(void **state)
{
    (void)state;
    BUILDERS_FOR(builder)
    check_every_kind(builder);
}

static void qualities_differ(void **state)
{
    (void)state;
    struct memory memory;
    struct test_shape shape = soup;
    struct test_model model;
    struct build_stats stats[QUALITY_HIGH + 1];
    shape.detail = 0.2;
    shape.primitives = 2000;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    test_model_make(&shape, 2, &model);
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
        struct ir ir = sound_ir(&model.canonical, quality, &context, &stats[quality]);
        ir_finish(&ir);
    }
    assert_true(stats[QUALITY_BALANCED].sah < stats[QUALITY_FAST].sah);
    assert_true(stats[QUALITY_HIGH].sah < stats[QUALITY_BALANCED].sah);
    assert_true(stats[QUALITY_HIGH].refs > stats[QUALITY_BALANCED].refs);
    /* There are no splits with LOW_MEMORY or ALLOW_UPDATE, nor where an any-hit shader must run only once. */
    static const uint32_t flags[] = {BUILD_LOW_MEMORY, BUILD_ALLOW_UPDATE};
    struct ir ir;
    for (int i = 0; i < 2; i++) {
        model.canonical.flags = flags[i];
        ir = sound_ir(&model.canonical, QUALITY_HIGH, &context, &stats[0]);
        assert_string_equal(stats[0].method, "binned");
        ir_finish(&ir);
    }
    model.canonical.flags = 0;
    model.canonical.geometries[0].flags = GEOMETRY_NO_DUPLICATE_ANY_HIT;
    ir = sound_ir(&model.canonical, QUALITY_HIGH, &context, &stats[0]);
    assert_string_equal(stats[0].method, "binned");
    assert_int_equal(stats[0].refs, stats[QUALITY_BALANCED].refs);
    ir_finish(&ir);
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

static void qualities_have_names(void **state)
{
    (void)state;
    assert_string_equal(build_quality_name(QUALITY_FAST), "fast");
    assert_string_equal(build_quality_name(QUALITY_HIGH), "high");
    assert_string_equal(build_quality_name((enum build_quality)77), "unknown");
    enum build_builder builder = BUILDER_OWN;
    assert_true(build_builder_from_name("embree", &builder));
    assert_int_equal(builder, BUILDER_EMBREE);
    assert_false(build_builder_from_name("Embree", &builder));
    assert_string_equal(build_builder_name(BUILDER_OWN), "own");
    assert_string_equal(build_builder_name((enum build_builder)77), "unknown");
}

static const uint32_t sampled[] = {GEOMETRY_TRIANGLES, GEOMETRY_SWEPT_SPHERES, GEOMETRY_MOVING_TRIANGLES,
                                   GEOMETRY_MOVING_INSTANCES};

static void check_threads(enum build_builder builder, uint32_t type)
{
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
        struct test_shape shape = soup_of(type);
        struct test_model model;
        struct build_options options = options_for(builder, quality);
        unsigned char *first = NULL;
        uint64_t size = 0;
        shape.primitives = builder ? 3000 : type != GEOMETRY_TRIANGLES ? 12000 : 30000; /* more than one piece */
        test_model_make(&shape, 3, &model);
        for (unsigned threads = 1; threads <= 8; threads = threads * 3 - 1) {
            struct workers *workers;
            struct build_stats stats;
            unsigned char *blob;
            assert_int_equal(workers_create(threads, &workers, NULL), BVHD_OK);
            struct build_context context = context_over(&memory, workers_parallel(workers));
            assert_int_equal(build(&model.canonical, &options, &context, &blob, &stats, NULL), BVHD_OK);
            if (first) {
                assert_int_equal(stats.sizes.total, size);
                assert_memory_equal(blob, first, size);
                memory_free(&memory, blob);
            } else {
                first = blob;
                size = stats.sizes.total;
            }
            workers_destroy(workers);
        }
        memory_free(&memory, first);
        test_model_finish(&model);
    }
    assert_int_equal(memory.live, 0);
}

static void bytes_do_not_depend_on_threads(void **state)
{
    (void)state;
    BUILDERS_FOR(builder)
    for (size_t i = 0; i < sizeof sampled / sizeof *sampled; i++)
        check_threads(builder, sampled[i]);
}

/* Builds work for magnitudes at the ends of float's range. */
static void check_magnitudes(enum build_builder builder)
{
    static const double sizes[] = {0, 1e-44, 1e-38, 1e-30, 1e-3, 1e18, 1e30, 3e38};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    for (int t = 0; t < KIND_OF_RAYS; t++)
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
            for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
                struct test_shape shape = soup_of(types[t]);
                struct test_model model;
                struct build_stats stats;
                shape.primitives = quality == QUALITY_HIGH ? 300 : 1500;
                shape.size = sizes[i];
                test_model_make(&shape, 6, &model);
                struct ir ir = sound_ir_by(builder, &model.canonical, quality, &context, &stats);
                assert_true(types[t] != GEOMETRY_AABBS || stats.refs >= model.canonical.primitive_count);
                assert_true(stats.depth < (types[t] == GEOMETRY_MOVING_INSTANCES ? 64 : 40));
                ir_finish(&ir);
                test_model_finish(&model);
            }
    assert_int_equal(memory.live, 0);
}

static void magnitudes_do_not_matter(void **state)
{
    (void)state;
    BUILDERS_FOR(builder)
    check_magnitudes(builder);
}

static void scale_does_not_change_the_tree(void **state)
{
    (void)state;
    struct memory memory;
    struct ir irs[3];
    struct build_stats stats;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    static const double sizes[] = {0x1p70, 0x1p-70, 0x1p100};
    for (int i = 0; i < 3; i++) {
        struct test_shape shape = soup;
        struct test_model model;
        shape.size = sizes[i];
        test_model_make(&shape, 6, &model);
        irs[i] = sound_ir(&model.canonical, QUALITY_BALANCED, &context, &stats);
        assert_int_equal(irs[i].node_count, irs[0].node_count);
        assert_memory_equal(irs[i].nodes, irs[0].nodes, irs[0].node_count * sizeof *irs[0].nodes);
        assert_memory_equal(irs[i].refs, irs[0].refs, irs[0].ref_count * sizeof *irs[0].refs);
        test_model_finish(&model);
    }
    for (int i = 0; i < 3; i++)
        ir_finish(&irs[i]);
    assert_int_equal(memory.live, 0);
}

/*
 * Boxes whose distances from the origin grow by a constant factor, starting at `least`, make a tree whose natural depth
 * is over 64; its wide nodes must stay within the layout's limit.
 */
static void limit_deep_trees(enum build_builder builder, double least)
{
    enum { COUNT = 5000 };
    float *boxes = calloc(COUNT * 6, sizeof *boxes);
    assert_non_null(boxes);
    for (int i = 0; i < COUNT; i++)
        for (int axis = 0; axis < 3; axis++) {
            boxes[6 * i + axis] = axis ? 0 : (float)(least * pow(1.012, i % 4500));
            boxes[6 * i + 3 + axis] = boxes[6 * i + axis] * 1.001f;
        }
    struct canonical_geometry geometry = {.type = GEOMETRY_AABBS, .primitive_count = COUNT, .boxes = boxes};
    struct canonical canonical = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = COUNT, .geometries = &geometry};
    struct memory memory;
    struct build_stats stats;
    unsigned char *blob;
    struct portable_view view;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_BALANCED; quality++) {
        struct ir ir = sound_ir_by(builder, &canonical, quality, &context, &stats);
        assert_true(stats.depth <= 64);
        ir_finish(&ir);
        struct build_options options = options_for(builder, quality);
        assert_int_equal(build(&canonical, &options, &context, &blob, &stats, NULL), BVHD_OK);
        assert_int_equal(portable_open((struct bytes){blob, stats.sizes.total}, &memory, &view, NULL), BVHD_OK);
        assert_true(view.header->depth <= PORTABLE_MAX_DEPTH);
        assert_true(stats.depth <= 64);
        memory_free(&memory, blob);
    }
    free(boxes);
    assert_int_equal(memory.live, 0);
}

static void deep_trees_are_limited(void **state)
{
    (void)state;
    BUILDERS_FOR(builder)
    {
        limit_deep_trees(builder, 1); /* reaches magnitudes at which the scene is rescaled */
        limit_deep_trees(builder, 0x1p-40);
    }
}

static void empty_structures(void **state)
{
    (void)state;
    static const float nowhere[9] = {NAN};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    for (uint32_t count = 0; count < 2; count++) {
        struct canonical_geometry geometry = {
            .type = GEOMETRY_TRIANGLES, .primitive_count = count, .vertex_count = 3 * count, .positions = nowhere};
        struct canonical canonical = {
            .type = STRUCTURE_BOTTOM, .geometry_count = count, .primitive_count = count, .geometries = &geometry};
        struct build_stats stats;
        unsigned char *blob;
        struct portable_view view;
        struct ir ir = sound_ir(&canonical, QUALITY_BALANCED, &context, &stats);
        assert_int_equal(ir.node_count, 0);
        assert_string_equal(stats.method, "none");
        ir_finish(&ir);
        assert_int_equal(build(&canonical, &balanced, &context, &blob, &stats, NULL), BVHD_OK);
        assert_int_equal(stats.inactive, count);
        assert_true(box_is_empty(&stats.bounds));
        assert_int_equal(portable_open((struct bytes){blob, stats.sizes.total}, &memory, &view, NULL), BVHD_OK);
        assert_int_equal(view.header->node_count, 0);
        memory_free(&memory, blob);
    }
    assert_int_equal(memory.live, 0);
}

static void options_are_checked(void **state)
{
    (void)state;
    struct test_model model;
    struct memory memory;
    struct build_stats stats;
    struct bvhd_error error;
    unsigned char *blob;
    memory_init(&memory, UINT64_MAX);
    test_model_make(&soup, 1, &model);
    struct build_context context = context_over(&memory, &parallel_serial);
    struct build_options options = balanced;
    options.target = (enum target)99;
    assert_int_equal(build(&model.canonical, &options, &context, &blob, &stats, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "options.target");
    options = balanced;
    options.layout_flags = 0x80000000;
    assert_int_equal(build(&model.canonical, &options, &context, &blob, &stats, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "options.layoutFlags");
    options = balanced;
    options.builder = (enum build_builder)2;
    assert_int_equal(build(&model.canonical, &options, &context, &blob, &stats, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "build.builder");
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

/*
 * Each allocation fails once: nothing leaks, the error is BVHD_NO_MEMORY, and the same input builds in the next
 * attempt.
 */
static void fail_allocations(enum build_builder builder, uint32_t type)
{
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
        struct test_shape shape = soup_of(type);
        struct test_model model;
        struct memory memory;
        struct build_options options = options_for(builder, quality);
        enum bvhd_status status = BVHD_NO_MEMORY;
        shape.primitives = quality == QUALITY_BALANCED ? 3000 : 300;
        test_model_make(&shape, 1, &model);
        memory_init(&memory, UINT64_MAX);
        struct build_context context = context_over(&memory, &parallel_serial);
        int64_t n = 0;
        for (; status == BVHD_NO_MEMORY; n++) {
            struct build_stats stats;
            struct bvhd_error error = {.status = BVHD_OK};
            unsigned char *blob = NULL;
            memory.fail_after = n;
            status = build(&model.canonical, &options, &context, &blob, &stats, &error);
            assert_int_equal(error.status, status);
            assert_true(status == BVHD_OK || !blob);
            memory_free(&memory, blob);
            assert_int_equal(memory.live, 0);
        }
        assert_int_equal(status, BVHD_OK);
        assert_true(n > 15);
        test_model_finish(&model);
    }
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    BUILDERS_FOR(builder)
    for (size_t i = 0; i < sizeof sampled / sizeof *sampled; i++)
        fail_allocations(builder, sampled[i]);
}

struct cancelling {
    atomic_bool cancel;
    uint64_t at, last, total;
};

static void on_progress(void *context, uint64_t done, uint64_t total)
{
    struct cancelling *cancelling = context;
    assert_true(done <= total);
    assert_true(done >= cancelling->last);
    cancelling->last = done;
    cancelling->total = total;
    if (done >= cancelling->at)
        atomic_store(&cancelling->cancel, true);
}

static void cancelling_ends_it(void **state)
{
    (void)state;
    struct test_model model;
    struct memory memory;
    struct test_shape shape = soup;
    shape.primitives = 20000;
    memory_init(&memory, UINT64_MAX);
    test_model_make(&shape, 1, &model);
    for (uint64_t at = 0; at <= 50000; at += 10000) {
        struct cancelling cancelling = {false, at, 0, 0};
        struct build_context context = context_over(&memory, &parallel_serial);
        struct build_stats stats;
        struct bvhd_error error;
        unsigned char *blob;
        context.cancel = &cancelling.cancel;
        context.progress = on_progress;
        context.progress_context = &cancelling;
        atomic_store(&cancelling.cancel, at == 0);
        enum bvhd_status status = build(&model.canonical, &balanced, &context, &blob, &stats, &error);
        if (at <= 40000) {
            assert_int_equal(status, BVHD_CANCELLED);
            assert_int_equal(error.status, BVHD_CANCELLED);
            assert_true(cancelling.last < at + 8000);
        } else {
            assert_int_equal(status, BVHD_OK);
            assert_int_equal(cancelling.last, 40000);
            assert_int_equal(cancelling.total, 40000);
            memory_free(&memory, blob);
        }
        assert_int_equal(memory.live, 0);
    }
    test_model_finish(&model);
}

/* An output that counts its calls, and may set the cancel flag when it allocates. */
struct test_output {
    struct build_output output;
    struct memory memory;
    unsigned calls, discards;
    uint64_t size;
    atomic_bool *cancel;
};

static unsigned char *room_allocate(struct build_output *self, uint64_t size)
{
    struct test_output *output = (struct test_output *)self;
    output->calls++;
    output->size = size;
    if (output->cancel)
        atomic_store(output->cancel, true);
    return memory_alloc(&output->memory, size);
}

static void room_discard(struct build_output *self, unsigned char *bytes)
{
    struct test_output *output = (struct test_output *)self;
    output->discards++;
    memory_free(&output->memory, bytes);
}

static void output_init(struct test_output *output)
{
    *output = (struct test_output){.output = {room_allocate, room_discard}};
    memory_init(&output->memory, UINT64_MAX);
}

/* A model with vertices that no triangle uses, so that the size of the blob is not known from the start. */
static void model_with_spare_vertices(struct test_model *model)
{
    struct test_shape shape = soup;
    shape.primitives = 500;
    test_model_make(&shape, 1, model);
    model->canonical.geometries[0].primitive_count -= 100;
    model->canonical.geometries[1].first_primitive -= 100;
    model->canonical.primitive_count -= 100;
}

static void a_blob_goes_to_its_output(void **state)
{
    (void)state;
    struct test_model model;
    struct memory memory;
    struct test_output output;
    struct build_stats stats, same;
    unsigned char *blob, *other;
    memory_init(&memory, UINT64_MAX);
    output_init(&output);
    model_with_spare_vertices(&model);
    struct build_context context = context_over(&memory, &parallel_serial);
    assert_int_equal(build(&model.canonical, &balanced, &context, &blob, &stats, NULL), BVHD_OK);
    assert_int_equal(memory.live, stats.sizes.total);
    assert_true(stats.sizes.vertices < (uint64_t)model.canonical.vertex_count * 12);
    context.output = &output.output;
    assert_int_equal(build(&model.canonical, &balanced, &context, &other, &same, NULL), BVHD_OK);
    assert_int_equal(memory.live, stats.sizes.total);
    assert_int_equal(output.calls, 1);
    assert_int_equal(output.discards, 0);
    assert_int_equal(output.size, stats.sizes.total);
    assert_int_equal(same.sizes.total, stats.sizes.total);
    assert_memory_equal(other, blob, stats.sizes.total);
    memory_free(&output.memory, other);
    memory_free(&memory, blob);
    test_model_finish(&model);
}

static void an_output_gets_back_what_is_not_wanted(void **state)
{
    (void)state;
    struct test_model model;
    struct memory memory;
    struct test_output output;
    struct build_stats stats;
    struct bvhd_error error;
    unsigned char *blob = NULL;
    atomic_bool cancel = false;
    memory_init(&memory, UINT64_MAX);
    output_init(&output);
    model_with_spare_vertices(&model);
    struct build_context context = context_over(&memory, &parallel_serial);
    context.output = &output.output;
    context.cancel = &cancel;
    output.cancel = &cancel;
    assert_int_equal(build(&model.canonical, &balanced, &context, &blob, &stats, &error), BVHD_CANCELLED);
    assert_int_equal(error.status, BVHD_CANCELLED);
    assert_int_equal(output.discards, 1);
    assert_int_equal(output.memory.live + memory.live, 0);
    assert_null(blob);
    output.cancel = NULL;
    atomic_store(&cancel, false);
    output.memory.limit = 100;
    assert_int_equal(build(&model.canonical, &balanced, &context, &blob, &stats, &error), BVHD_NO_MEMORY);
    assert_int_equal(output.calls, 2);
    assert_int_equal(output.discards, 1);
    assert_int_equal(output.memory.live + memory.live, 0);
    assert_null(blob);
    test_model_finish(&model);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_of_primitive_and_quality),
        cmocka_unit_test(qualities_differ),
        cmocka_unit_test(qualities_have_names),
        cmocka_unit_test(bytes_do_not_depend_on_threads),
        cmocka_unit_test(magnitudes_do_not_matter),
        cmocka_unit_test(scale_does_not_change_the_tree),
        cmocka_unit_test(deep_trees_are_limited),
        cmocka_unit_test(empty_structures),
        cmocka_unit_test(options_are_checked),
        cmocka_unit_test(failing_allocations_leave_nothing),
        cmocka_unit_test(cancelling_ends_it),
        cmocka_unit_test(a_blob_goes_to_its_output),
        cmocka_unit_test(an_output_gets_back_what_is_not_wanted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
