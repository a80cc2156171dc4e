/* SPDX-License-Identifier: Apache-2.0 */
/* test_tier.c - tests that the quality of least cost is chosen, and that equal qualities share a result. */
#include "tests/support/unit.h"

#include <math.h>
#include <string.h>

#include "builder/update/batch.h"
#include "builder/content_key.h"
#include "tests/support/builder/test_ir.h"
#include "builder/tier.h"

static enum build_quality resolve(enum build_quality asked, uint32_t flags, float rays)
{
    static struct test_model model;
    if (!model.canonical.primitive_count)
        test_model_make(
            &(struct test_shape){
                .type = GEOMETRY_TRIANGLES, .geometries = 2, .primitives = 500, .size = 1, .detail = 0.1},
            1, &model);
    struct canonical canonical = model.canonical;
    canonical.flags = flags;
    return tier_resolve(&canonical, &(struct build_options){.quality = asked, .rays_per_primitive = rays});
}

static void what_is_named_stays(void **state)
{
    (void)state;
    static const float rays[] = {0, 0.001f, 1, 1e30f};
    static const uint32_t flags[] = {0, BUILD_PREFER_FAST_BUILD, BUILD_PREFER_FAST_TRACE};
    for (int i = 0; i < 12; i++) {
        for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
            assert_int_equal(resolve(quality, flags[i % 3], rays[i / 3]), quality);
        if (i % 3)
            assert_int_equal(resolve(QUALITY_UNSPECIFIED, flags[i % 3], rays[i / 3]),
                             i % 3 == 1 ? QUALITY_FAST : QUALITY_HIGH);
        assert_int_equal(resolve(QUALITY_AUTO, flags[i % 3], rays[i / 3]),
                         resolve(QUALITY_UNSPECIFIED, 0, rays[i / 3]));
    }
}

static void few_rays_are_for_fast_and_many_for_high(void **state)
{
    (void)state;
    assert_int_equal(resolve(QUALITY_AUTO, 0, 0), QUALITY_BALANCED);
    assert_int_equal(resolve(QUALITY_AUTO, 0, 1e-30f), QUALITY_FAST);
    assert_int_equal(resolve(QUALITY_AUTO, 0, 0.1f), QUALITY_FAST);
    assert_int_equal(resolve(QUALITY_AUTO, 0, 3e38f), resolve(QUALITY_AUTO, 0, 1e6f));
}

/* More rays never choose a quality that takes less time to build, and the chosen quality costs least. */
static void more_rays_never_choose_less(void **state)
{
    (void)state;
    static const double crossings[] = {0, 2, 30, 500, 1e9}, thicknesses[] = {0, 0.01, 0.3, 1};
    for (int i = 0; i < 60; i++) {
        struct facts facts = {.primitives = 1u << 2 * (i % 12),
                              .sampled = 1,
                              .met = 1,
                              .can_split = true,
                              .crossings = crossings[i % 5],
                              .unevenness = i / 20 * 0.5,
                              .thickness = thicknesses[i / 5 % 4]};
        double before = 0;
        for (float rays = 0.001f; rays < 1e6f; rays *= 1.5f) {
            enum build_quality chosen = tier_choose(&facts, rays);
            struct tier_cost cost = tier_cost(chosen, &facts);
            assert_true(cost.build_ns >= before && isfinite(cost.build_ns) && cost.ray_ns > 0);
            before = cost.build_ns;
            for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
                struct tier_cost other = tier_cost(quality, &facts);
                assert_true(cost.build_ns + rays * cost.ray_ns <= other.build_ns + rays * other.ray_ns);
            }
        }
    }
}

/* Without splits, HIGH is only a slower BALANCED, so it is never chosen. */
static void high_is_for_what_can_be_split(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct facts facts = {.primitives = 100000,
                              .sampled = 1,
                              .met = 1,
                              .can_split = i,
                              .crossings = 200,
                              .unevenness = 0.8,
                              .thickness = 1};
        assert_int_equal(tier_choose(&facts, 1e6f) == QUALITY_HIGH, i);
    }
}

/* Adds two triangles that form a square of side 1 perpendicular to an axis. */
static void add_square(float (*corners)[3], int axis, float x, float y, float z)
{
    static const float square[6][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 0}, {1, 1}, {0, 1}};
    for (int i = 0; i < 6; i++) {
        float corner[3] = {x, y, z};
        corner[(axis + 1) % 3] += square[i][0];
        corner[(axis + 2) % 3] += square[i][1];
        memcpy(corners[i], corner, sizeof corner);
    }
}

enum { SIDE = 48, SQUARES = 3 * SIDE * SIDE };

/*
 * Triangles that fill their boxes, or half of them, as floors and blocks have, leave no empty space that splits could
 * remove: none are made. Inactive ones are left out.
 */
static void nothing_is_split_in_vain(void **state)
{
    (void)state;
    static float corners[6 * SQUARES][3];
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    for (int voxels = 0; voxels < 2; voxels++) {
        uint32_t count = 0, inactive = 0;
        for (int i = 0; i < SIDE * SIDE; i++) {
            float x = (float)(i % SIDE), z = (float)(i / SIDE), y = voxels ? (float)(i * 7919 % 13) : 0;
            for (int axis = voxels ? 0 : 1; axis < (voxels ? 3 : 2); axis++, count++)
                add_square(corners + 6 * (size_t)count, axis, x, y, z);
        }
        for (uint32_t i = 0; i < count; i += 10, inactive += 2)
            corners[6 * (size_t)i][0] = corners[6 * (size_t)i + 3][0] = NAN;
        struct canonical_geometry geometry = {.type = GEOMETRY_TRIANGLES,
                                              .primitive_count = 2 * count,
                                              .vertex_count = 6 * count,
                                              .positions = corners[0]};
        struct canonical canonical = {
            .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 2 * count, .geometries = &geometry};
        struct build_options options = {.quality = QUALITY_HIGH, .target = TARGET_PORTABLE};
        struct build_stats stats;
        struct ir ir;
        assert_int_equal(build_ir(&canonical, &options, &context, &ir, &stats, NULL), BVHD_OK);
        assert_int_equal(stats.inactive, inactive);
        assert_int_equal(stats.refs, 2 * count - inactive);
        ir_finish(&ir);
    }
    assert_int_equal(memory.live, 0);
}

/* Numbers of rays that lead to one quality share its result, also with a request that names this quality. */
static void hints_of_one_tier_share_a_result(void **state)
{
    (void)state;
    static const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    struct geometry geometry = {.type = GEOMETRY_TRIANGLES,
                                .triangles = {.vertex_format = 106,
                                              .max_vertex = 2,
                                              .vertex_stride = 12,
                                              .index_type = INDEX_NONE,
                                              .vertices = {(const unsigned char *)corners, sizeof corners}},
                                .range = {.primitive_count = 1}};
    enum { ITEMS = 4 };
    struct build_input inputs[ITEMS];
    struct batch_item items[ITEMS];
    struct limits limits = limits_default();
    for (int i = 0; i < ITEMS; i++)
        inputs[i] = (struct build_input){
            .type = STRUCTURE_BOTTOM,
            .geometry_count = 1,
            .geometries = &geometry,
            .options = {.target = TARGET_PORTABLE, .quality = QUALITY_AUTO, .rays_per_primitive = 0.001f}};
    inputs[1].options.rays_per_primitive = 0.002f;
    inputs[2].options =
        (struct build_options){.target = TARGET_PORTABLE, .quality = QUALITY_FAST, .rays_per_primitive = 1000};
    inputs[3].options = (struct build_options){.target = TARGET_PORTABLE, .quality = QUALITY_HIGH};
    assert_int_equal(batch_build(inputs, ITEMS, &limits, &context, items, NULL), BVHD_OK);
    for (int i = 0; i < ITEMS; i++) {
        assert_int_equal(items[i].status, BVHD_OK);
        assert_int_equal(items[i].summary.quality, i < 3 ? QUALITY_FAST : QUALITY_HIGH);
        assert_int_equal(items[i].coalesced, i == 1 || i == 2);
        assert_int_equal(key_equal(&items[i].key, &items[0].key), i < 3);
    }
    batch_finish(items, ITEMS, &memory);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_named_stays),         cmocka_unit_test(few_rays_are_for_fast_and_many_for_high),
        cmocka_unit_test(more_rays_never_choose_less), cmocka_unit_test(high_is_for_what_can_be_split),
        cmocka_unit_test(nothing_is_split_in_vain),    cmocka_unit_test(hints_of_one_tier_share_a_result),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
