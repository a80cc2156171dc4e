/* SPDX-License-Identifier: Apache-2.0 */
/* test_size_bound.c - tests that no structure is larger than its bound, and that bounds grow with every count. */
#include "tests/support/unit.h"

#include "builder/update/batch.h"
#include "builder/format/layout.h"
#include "builder/format/serialized.h"
#include "builder/format/size_bound.h"
#include "tests/support/builder/builders.h"
#include "tests/support/builder/random_input.h"
#include "tests/support/builder/random_top.h"

enum { CASES = 240, MOST_PRIMITIVES = 600, LARGE_CASES = 4, LARGE = 5000 };

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};

/* Builds for a target, and compares what a loader would create with the bound. Returns the size. */
static uint64_t check_bound(struct build_input *input, uint64_t seed)
{
    struct limits limits = limits_default();
    struct batch_item item;
    struct bvhd_error error;
    struct serialized_header header;
    input->options.builder = builders_asked();
    const uint64_t bound = size_bound(input);
    assert_int_equal(batch_build(input, 1, &limits, &context, &item, &error), BVHD_OK);
    if (item.status != BVHD_OK)
        fail_msg("seed %llu: %s: %s", (unsigned long long)seed, item.error.where, item.error.text);
    assert_int_equal(serialized_read((struct bytes){item.blob, item.size}, &header, &error), BVHD_OK);
    if (header.deserialized_size > bound)
        fail_msg("seed %llu, target %d, quality %d: %llu bytes, but the bound is %llu", (unsigned long long)seed,
                 (int)input->options.target, (int)input->options.quality, (unsigned long long)header.deserialized_size,
                 (unsigned long long)bound);
    batch_finish(&item, 1, &memory);
    return header.deserialized_size;
}

static void make_native(struct build_input *input, uint32_t variant)
{
    input->options.target = TARGET_LAVAPIPE;
    input->options.layout_flags = 0;
    input->options.device.variant = variant;
}

/* Returns whether a native layout has structures of this kind. */
static bool may_be_native(const struct build_input *input)
{
    return input->geometry_count == 0 || layout_lavapipe.version(input->geometries[0].type) > 0;
}

static void no_structure_is_larger(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= CASES + LARGE_CASES; seed++) {
        struct random random = {seed * UINT64_C(0x9e3779b97f4a7c15)};
        struct random_input input;
        random_input_bottom(&input, &random, seed > CASES ? LARGE : MOST_PRIMITIVES);
        check_bound(&input.input, seed);
        for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
            input.input.options.quality = quality;
            check_bound(&input.input, seed);
        }
        make_native(&input.input, 1 + seed % 2);
        if (may_be_native(&input.input))
            check_bound(&input.input, seed);
        random_input_finish(&input);
    }
    assert_int_equal(memory.live, 0);
}

/* Geometry that stands still takes as much as what moves beside it, wherever it is in the request. */
static void no_moving_structure_is_larger(void **state)
{
    (void)state;
    uint64_t moving = 0;
    for (uint64_t seed = 1; seed <= 10 * CASES; seed++) {
        struct random random = {seed * UINT64_C(0x9e3779b97f4a7c15)};
        struct random_input input;
        random_input_bottom_of(&input, &random, seed % 8 ? 16 : MOST_PRIMITIVES, RANDOM_MOTION);
        moving += random_input_moves(&input);
        check_bound(&input.input, seed);
        random_input_finish(&input);
    }
    assert_true(moving > CASES);
    assert_int_equal(memory.live, 0);
}

/* Every vertex is used by one primitive alone, in small structures and in those of several pieces. */
static void no_round_structure_is_larger(void **state)
{
    enum { MOST = 2 * LARGE };
    static float vertices[MOST][4];
    struct random random = {17};
    (void)state;
    for (int i = 0; i < MOST; i++)
        for (int k = 0; k < 4; k++)
            vertices[i][k] = (float)random_between(&random, k == 3 ? 0 : -10, k == 3 ? 0.1 : 10);
    for (int round = 0; round < 24; round++) {
        struct geometry geometry = {.type = round % 2 ? GEOMETRY_SWEPT_SPHERES : GEOMETRY_SPHERES};
        geometry.spheres = (struct geometry_spheres){
            .vertex_format = 106,
            .radius_format = 100,
            .index_type = INDEX_NONE,
            .vertex_stride = 16,
            .radius_stride = 16,
            .vertices = {(const unsigned char *)vertices, sizeof vertices},
            .radii = {(const unsigned char *)&vertices[0][3], sizeof vertices - 12},
        };
        geometry.range.primitive_count = round < 6 ? (uint32_t)round : round < 18 ? (uint32_t)(1 + 50 * round) : LARGE;
        struct build_input input = {
            .type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &geometry, .options.target = TARGET_PORTABLE};
        for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
            input.options.quality = quality;
            check_bound(&input, (uint64_t)round);
        }
    }
    assert_int_equal(memory.live, 0);
}

static void no_top_level_is_larger(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= CASES / 8; seed++) {
        struct random random = {seed * UINT64_C(0x632be59bd9b4e019)};
        struct random_top top;
        random_top_init(&top, &random, 8);
        check_bound(&top.input, seed);
        make_native(&top.input, 1 + seed % 2);
        check_bound(&top.input, seed);
        random_top_finish(&top);
    }
}

/* Returns a random request without memory. */
static struct build_input random_shape(struct random *random, struct geometry geometries[3])
{
    static const uint32_t index_types[] = {INDEX_NONE, INDEX_UINT16, INDEX_UINT32};
    struct build_input input = {.type = STRUCTURE_BOTTOM,
                                .geometry_count = 1 + random_below(random, 3),
                                .geometries = geometries,
                                .options.target = TARGET_PORTABLE};
    static const uint32_t types[] = {GEOMETRY_TRIANGLES, GEOMETRY_TRIANGLES, GEOMETRY_AABBS, GEOMETRY_SPHERES,
                                     GEOMETRY_SWEPT_SPHERES};
    const uint32_t type = types[random_below(random, 5)];
    random_input_options(&input, random);
    for (uint32_t i = 0; i < 3; i++) {
        geometries[i] = (struct geometry){.type = type, .flags = random_below(random, 4)};
        geometries[i].range.primitive_count = random_below(random, 1u << random_below(random, 24));
        if (type == GEOMETRY_TRIANGLES) {
            geometries[i].triangles.index_type = index_types[random_below(random, 3)];
            geometries[i].triangles.max_vertex = random_below(random, 1u << random_below(random, 24));
        }
    }
    if (random_chance(random, 0.5) && may_be_native(&input))
        make_native(&input, 1);
    return input;
}

static void bounds_grow_with_counts(void **state)
{
    (void)state;
    struct random random = {11};
    for (int i = 0; i < 20000; i++) {
        struct geometry geometries[3];
        struct build_input input = random_shape(&random, geometries);
        struct geometry *changed = &geometries[random_below(&random, input.geometry_count)];
        const uint64_t before = size_bound(&input);
        const uint32_t more = 1 + random_below(&random, 1u << random_below(&random, 16));
        switch (random_below(&random, 3)) {
        case 0:
            changed->range.primitive_count += more;
            break;
        case 1:
            input.geometry_count += input.geometry_count < 3;
            break;
        default:
            if (changed->type == GEOMETRY_TRIANGLES)
                changed->triangles.max_vertex += more;
        }
        assert_true(size_bound(&input) >= before);
        assert_true(before >= 40);
    }
}

/* A quality that is not named may be any of the three. */
static void any_quality_is_covered(void **state)
{
    (void)state;
    struct random random = {13};
    for (int i = 0; i < 2000; i++) {
        struct geometry geometries[3];
        struct build_input input = random_shape(&random, geometries);
        input.flags &= ~(uint32_t)(BUILD_PREFER_FAST_BUILD | BUILD_PREFER_FAST_TRACE);
        input.options.quality = QUALITY_UNSPECIFIED;
        const uint64_t any = size_bound(&input);
        input.options.quality = QUALITY_AUTO;
        assert_int_equal(size_bound(&input), any);
        for (input.options.quality = QUALITY_FAST; input.options.quality <= QUALITY_HIGH; input.options.quality++)
            assert_true(size_bound(&input) <= any);
        uint64_t fast = (input.options.quality = QUALITY_FAST, size_bound(&input));
        input.options.quality = QUALITY_UNSPECIFIED;
        input.flags |= BUILD_PREFER_FAST_BUILD;
        assert_int_equal(size_bound(&input), fast);
    }
}

/* The largest request overflows nothing. */
static void the_largest_request_has_a_bound(void **state)
{
    (void)state;
    struct geometry geometry = {.type = GEOMETRY_TRIANGLES, .range.primitive_count = LIMIT_MAX_PRIMITIVES};
    geometry.triangles.max_vertex = UINT32_MAX;
    geometry.triangles.index_type = INDEX_UINT32;
    struct build_input input = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &geometry, .options.target = TARGET_PORTABLE};
    uint64_t bound = size_bound(&input);
    assert_in_range(bound, LIMIT_MAX_PRIMITIVES * 100, LIMIT_MAX_PRIMITIVES * 400);
    make_native(&input, 1);
    assert_in_range(size_bound(&input), LIMIT_MAX_PRIMITIVES * 100, LIMIT_MAX_PRIMITIVES * 200);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_moving_structure_is_larger),   cmocka_unit_test(no_round_structure_is_larger),
        cmocka_unit_test(no_structure_is_larger),          cmocka_unit_test(no_top_level_is_larger),
        cmocka_unit_test(bounds_grow_with_counts),         cmocka_unit_test(any_quality_is_covered),
        cmocka_unit_test(the_largest_request_has_a_bound),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
