/* SPDX-License-Identifier: Apache-2.0 */
/* test_build_native.c - tests that builds for the lavapipe target are sound, shallow enough and repeatable. */
#include "tests/support/builder/builders.h"
#include "tests/support/unit.h"

#include <math.h>

#include "builder/build.h"
#include "builder/format/lavapipe.h"
#include "builder/input/primitive.h"
#include "tests/support/builder/test_ir.h"
#include "builder/workers.h"

static struct build_options native(enum build_quality quality, enum lavapipe_variant variant)
{
    return (struct build_options){
        .quality = quality, .target = TARGET_LAVAPIPE, .device = {.variant = variant}, .builder = builders_asked()};
}

static struct build_context context_over(struct memory *memory, const struct parallel *parallel)
{
    return (struct build_context){.memory = memory, .parallel = parallel};
}

/* A blob, and how often its tree references each leaf. */
struct built {
    unsigned char *blob;
    struct build_stats stats;
    struct lavapipe_view view;
    uint32_t *references; /* for each leaf, the references to it */
    uint64_t refs;
};

static void count_references(struct built *built, uint32_t offset)
{
    struct lavapipe_box box = lavapipe_box_at(&built->view, offset);
    for (int child = 0; child < 2; child++) {
        uint32_t reference = box.children[child];
        if (reference == LAVAPIPE_NONE)
            continue;
        if ((reference & 3) == LAVAPIPE_BOX) {
            count_references(built, reference & ~3u);
        } else {
            built->references[lavapipe_leaf_index(&built->view, reference)]++;
            built->refs++;
        }
    }
}

static void build_and_open(const struct canonical *canonical, const struct build_options *options,
                           const struct build_context *context, struct built *built)
{
    struct bvhd_error error;
    memset(built, 0, sizeof *built);
    if (build(canonical, options, context, &built->blob, &built->stats, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    struct bytes bytes = {built->blob, built->stats.sizes.total};
    if (lavapipe_open(bytes, (enum lavapipe_variant)options->device.variant, context->memory, &built->view, &error) !=
        BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    built->references = calloc(canonical->primitive_count + 1, sizeof *built->references);
    assert_non_null(built->references);
    count_references(built, LAVAPIPE_HEADER);
    assert_int_equal(built->refs, built->stats.refs);
    assert_true(built->view.levels <= LAVAPIPE_MAX_LEVELS);
    assert_int_equal(built->view.levels, built->stats.depth > 1 ? built->stats.depth - 1 : 1);
}

static void built_finish(struct built *built, struct memory *memory)
{
    free(built->references);
    memory_free(memory, built->blob);
}

/* Each primitive that can be hit is referenced, others are not, and only splits reference one more than once. */
static void check_references(const struct canonical *canonical, const struct built *built)
{
    bool split = strcmp(built->stats.method, "spatial") == 0 || strcmp(built->stats.method, "embree-high") == 0;
    for (uint32_t id = 0; id < canonical->primitive_count; id++) {
        const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
        struct box box = primitive_box(canonical, geometry, id - geometry->first_primitive);
        uint32_t references = built->references[id];
        assert_true(box_is_empty(&box) ? references == 0 : references == 1 || (split && references > 0));
    }
}

static void every_kind_quality_and_variant(void **state)
{
    (void)state;
    static const uint32_t types[] = {GEOMETRY_TRIANGLES, GEOMETRY_AABBS, GEOMETRY_INSTANCES};
    static const uint32_t counts[] = {0, 1, 2, 3, 5, 100, 3000};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    for (uint32_t i = 0; i < 3 * 7 * 3 * 2; i++) {
        uint32_t type = types[i % 3], count = counts[i / 3 % 7];
        struct test_shape shape = {.type = type,
                                   .geometries = type == GEOMETRY_INSTANCES ? 1 : 2,
                                   .primitives = count,
                                   .size = 10,
                                   .detail = 0.1};
        struct test_model model;
        struct built built;
        test_model_make(&shape, i, &model);
        for (uint32_t r = 0; r < model.canonical.reference_count; r++)
            model.canonical.references[r].bounds = (struct box){{0, 0, 0}, {1, 1, 1}};
        struct build_options options =
            native((enum build_quality)(QUALITY_FAST + i / 21 % 3), (enum lavapipe_variant)(1 + i / 63));
        build_and_open(&model.canonical, &options, &context, &built);
        check_references(&model.canonical, &built);
        built_finish(&built, &memory);
        test_model_finish(&model);
    }
    assert_int_equal(memory.live, 0);
}

static void high_splits(void **state)
{
    (void)state;
    static const struct test_shape shape = {
        .type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 3000, .size = 10, .detail = 0.8};
    struct memory memory;
    struct test_model model;
    struct built built;
    memory_init(&memory, UINT64_MAX);
    test_model_make(&shape, 1, &model);
    struct build_context context = context_over(&memory, &parallel_serial);
    struct build_options options = native(QUALITY_HIGH, LAVAPIPE_PLAIN);
    build_and_open(&model.canonical, &options, &context, &built);
    assert_true(built.refs > 3000);
    assert_int_equal(built.view.leaf_count, 3000);
    assert_int_equal(built.view.leaf_offset, 40 + 56 * (built.refs - 1));
    built_finish(&built, &memory);
    static const uint32_t flags[] = {BUILD_LOW_MEMORY, BUILD_ALLOW_UPDATE};
    for (int i = 0; i < 2; i++) {
        model.canonical.flags = flags[i];
        build_and_open(&model.canonical, &options, &context, &built);
        assert_int_equal(built.refs, 3000);
        assert_int_equal(built.stats.sizes.total, 56 + 40 + 56 * 2999 + 48 * 3000);
        built_finish(&built, &memory);
    }
    model.canonical.flags = 0;
    model.canonical.geometries[0].flags = GEOMETRY_NO_DUPLICATE_ANY_HIT;
    build_and_open(&model.canonical, &options, &context, &built);
    assert_int_equal(built.refs, 3000);
    built_finish(&built, &memory);
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

/*
 * With boxes each of which holds all smaller ones the natural tree is a chain, and the driver's traversal stack limits
 * the depth.
 */
static void chains_are_cut_to_24_levels(void **state)
{
    (void)state;
    enum { COUNT = 120 };
    float boxes[COUNT][6];
    struct canonical_geometry geometry = {.type = GEOMETRY_AABBS, .primitive_count = COUNT, .boxes = boxes[0]};
    struct canonical canonical = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = COUNT, .geometries = &geometry};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int i = 0; i < COUNT; i++)
        for (int k = 0; k < 6; k++)
            boxes[i][k] = ldexpf(k < 3 ? 1 : 1.5f, i / 2);
    struct build_context context = context_over(&memory, &parallel_serial);
    for (int q = QUALITY_FAST; q <= QUALITY_HIGH; q++) {
        struct build_options options = native((enum build_quality)q, LAVAPIPE_PLAIN), portable = options;
        struct build_stats stats;
        struct built built;
        struct ir ir;
        portable.target = TARGET_PORTABLE;
        assert_int_equal(build_ir(&canonical, &portable, &context, &ir, &stats, NULL), BVHD_OK);
        ir_finish(&ir);
        if (builders_asked() == BUILDER_OWN)
            assert_true(stats.depth > LAVAPIPE_MAX_LEVELS + 1); /* the depth without the limit */
        build_and_open(&canonical, &options, &context, &built);
        check_references(&canonical, &built);
        assert_true(built.view.levels <= 24);
        built_finish(&built, &memory);
    }
    assert_int_equal(memory.live, 0);
}

/*
 * Twenty thousand equal triangles cannot be told apart; halving their number at each level keeps the tree within the
 * limit.
 */
static void equal_primitives_fit(void **state)
{
    (void)state;
    enum { COUNT = 20000 };
    static const float corners[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 1}};
    static uint32_t indices[COUNT][3];
    for (uint32_t i = 0; i < COUNT; i++)
        for (uint32_t k = 0; k < 3; k++)
            indices[i][k] = k;
    struct canonical_geometry geometry = {.type = GEOMETRY_TRIANGLES,
                                          .primitive_count = COUNT,
                                          .vertex_count = 3,
                                          .positions = corners[0],
                                          .indices = indices[0]};
    struct canonical canonical = {.type = STRUCTURE_BOTTOM,
                                  .geometry_count = 1,
                                  .primitive_count = COUNT,
                                  .vertex_count = 3,
                                  .geometries = &geometry};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    for (int q = QUALITY_FAST; q <= QUALITY_HIGH; q++) {
        struct build_options options = native((enum build_quality)q, LAVAPIPE_PLAIN);
        struct built built;
        build_and_open(&canonical, &options, &context, &built);
        check_references(&canonical, &built);
        built_finish(&built, &memory);
    }
    assert_int_equal(memory.live, 0);
}

static void inactive_primitives_keep_their_leaves(void **state)
{
    (void)state;
    static const float nan_at_3[5][6] = {
        {0, 0, 0, 1, 1, 1}, {2, 0, 0, 3, 1, 1}, {4, 0, 0, 5, 1, 1}, {NAN, 0, 0, 1, 1, 1}, {6, 0, 0, 7, 1, 1}};
    struct canonical_geometry geometry = {.type = GEOMETRY_AABBS, .primitive_count = 5, .boxes = nan_at_3[0]};
    struct canonical canonical = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 5, .geometries = &geometry};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    struct build_options options = native(QUALITY_BALANCED, LAVAPIPE_PLAIN);
    struct built built;
    build_and_open(&canonical, &options, &context, &built);
    static const uint32_t expected[5] = {1, 1, 1, 0, 1};
    static const float bounds[6] = {0, 0, 0, 7, 1, 1};
    assert_memory_equal(built.references, expected, sizeof expected);
    assert_memory_equal(built.view.bounds, bounds, sizeof bounds);
    assert_int_equal(built.view.leaf_count, 5);
    assert_int_equal(lavapipe_aabb_at(&built.view, 3).primitive, 3);
    assert_true(isnan(lavapipe_aabb_at(&built.view, 3).min[0]));
    built_finish(&built, &memory);
    assert_int_equal(memory.live, 0);
}

static void a_variant_is_needed(void **state)
{
    (void)state;
    static const uint32_t wrong[] = {0, LAVAPIPE_VARIANTS + 1, UINT32_MAX};
    static const float box[6] = {0, 0, 0, 1, 1, 1};
    struct canonical_geometry geometry = {.type = GEOMETRY_AABBS, .primitive_count = 1, .boxes = box};
    struct canonical canonical = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 1, .geometries = &geometry};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct build_context context = context_over(&memory, &parallel_serial);
    for (int i = 0; i < 3; i++) {
        struct build_options options = native(QUALITY_BALANCED, (enum lavapipe_variant)wrong[i]);
        struct bvhd_error error;
        struct build_stats stats;
        unsigned char *blob = NULL;
        assert_int_equal(build(&canonical, &options, &context, &blob, &stats, &error), BVHD_UNSUPPORTED);
        assert_string_equal(error.where, "options.device");
        assert_null(blob);
    }
    struct build_options options = native(QUALITY_BALANCED, LAVAPIPE_PLAIN);
    struct bvhd_error error;
    struct build_stats stats;
    unsigned char *blob;
    options.layout_flags = PORTABLE_FAST_TRIANGLES;
    assert_int_equal(build(&canonical, &options, &context, &blob, &stats, &error), BVHD_UNSUPPORTED);
    assert_int_equal(memory.live, 0);
}

static void bytes_do_not_depend_on_threads(void **state)
{
    (void)state;
    const struct test_shape shape = {.type = GEOMETRY_TRIANGLES,
                                     .geometries = 2,
                                     .primitives = builders_asked() == BUILDER_OWN ? 30000 : 1500,
                                     .size = 10,
                                     .detail = 0.02};
    static const unsigned threads[] = {1, 2, 8};
    struct test_model model;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    test_model_make(&shape, 9, &model);
    for (int q = QUALITY_FAST; q <= QUALITY_HIGH; q++) {
        struct build_options options = native((enum build_quality)q, LAVAPIPE_PLAIN);
        struct build_context serial = context_over(&memory, &parallel_serial);
        struct built first;
        build_and_open(&model.canonical, &options, &serial, &first);
        for (int t = 0; t < 3; t++) {
            struct workers *workers;
            struct built again;
            assert_int_equal(workers_create(threads[t], &workers, NULL), BVHD_OK);
            struct build_context context = context_over(&memory, workers_parallel(workers));
            build_and_open(&model.canonical, &options, &context, &again);
            assert_int_equal(again.stats.sizes.total, first.stats.sizes.total);
            assert_memory_equal(again.blob, first.blob, first.stats.sizes.total);
            built_finish(&again, &memory);
            workers_destroy(workers);
        }
        built_finish(&first, &memory);
    }
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    static const struct test_shape shape = {
        .type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 2000, .size = 10, .detail = 0.2};
    struct test_model model;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    test_model_make(&shape, 9, &model);
    struct build_context context = context_over(&memory, &parallel_serial);
    struct build_options options = native(QUALITY_HIGH, LAVAPIPE_COMPACTED);
    struct build_stats stats;
    unsigned char *blob;
    for (int failures = 0;; failures++) {
        memory.fail_after = failures;
        enum bvhd_status status = build(&model.canonical, &options, &context, &blob, &stats, NULL);
        if (status == BVHD_OK)
            break;
        assert_int_equal(status, BVHD_NO_MEMORY);
        assert_int_equal(memory.live, 0);
    }
    memory.fail_after = -1;
    memory_free(&memory, blob);
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_quality_and_variant),        cmocka_unit_test(high_splits),
        cmocka_unit_test(chains_are_cut_to_24_levels),           cmocka_unit_test(equal_primitives_fit),
        cmocka_unit_test(inactive_primitives_keep_their_leaves), cmocka_unit_test(a_variant_is_needed),
        cmocka_unit_test(bytes_do_not_depend_on_threads),        cmocka_unit_test(failing_allocations_leave_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
