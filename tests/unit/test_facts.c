/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <math.h>
#include <stdlib.h>

#include "facts.h"
#include "inputs.h"
#include "prepare.h"

/* Triangles of a grid over [0, side] x [0, side] in the plane y = 0, two a square; `tilt` adds x * tilt to y. */
static struct canonical grid(struct canonical_geometry *geometry, uint32_t side, float tilt)
{
    static const uint32_t corners[6][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 0}, {1, 1}, {0, 1}};
    float *positions = malloc((size_t)side * side * 18 * sizeof *positions);
    assert_non_null(positions);
    for (uint32_t i = 0; i < side * side * 6; i++) {
        float x = (float)(i / 6 % side + corners[i % 6][0]);
        positions[3 * i] = x;
        positions[3 * i + 1] = tilt * x;
        positions[3 * i + 2] = (float)(i / 6 / side + corners[i % 6][1]);
    }
    *geometry = (struct canonical_geometry){
        .type = GEOMETRY_TRIANGLES, .primitive_count = 2 * side * side, .vertex_count = 6 * side * side, .positions = positions};
    return (struct canonical){
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = geometry->primitive_count, .geometries = geometry};
}

/* Every line through a flat grid meets two boxes: each square is the box of two triangles. Nothing slants. */
static void a_flat_grid(void **state)
{
    (void)state;
    static const uint32_t sides[] = {1, 3, 8, 45, 300}, samples[] = {2, 18, FACTS_LEAST, 126, FACTS_MOST};
    for (size_t i = 0; i < sizeof sides / sizeof sides[0]; i++) {
        struct canonical_geometry geometry;
        struct canonical canonical = grid(&geometry, sides[i], 0);
        struct facts facts;
        facts_gather(&canonical, &facts);
        assert_int_equal(facts.primitives, 2 * sides[i] * sides[i]);
        assert_int_equal(facts.sampled, samples[i]);
        assert_int_equal(facts.met, facts.sampled);
        assert_true(facts.can_split);
        assert_true(fabs(facts.crossings - 2) < 0.3);
        assert_true(facts.slant < 1e-6 && facts.spread < 1e-6);
        canonical.flags = i % 2 ? BUILD_ALLOW_UPDATE : BUILD_LOW_MEMORY;
        facts_gather(&canonical, &facts);
        assert_false(facts.can_split);
        free((void *)(uintptr_t)geometry.positions);
    }
}

/* Tilted by 45 degrees a square's box has the half area 1 + 1 + 1, its two triangles sqrt(2) each by twice their area. */
static void a_slope_slants(void **state)
{
    (void)state;
    struct canonical_geometry geometry;
    struct canonical canonical = grid(&geometry, 20, 1);
    struct facts facts;
    facts_gather(&canonical, &facts);
    assert_true(fabs(facts.slant - (3 - sqrt(2)) / 3) < 1e-6);
    free((void *)(uintptr_t)geometry.positions);
}

/* One of two sizes, three octaves apart: the standard deviation is one and a half. */
static void sizes_spread(void **state)
{
    (void)state;
    float boxes[200][6] = {{0}};
    for (int i = 0; i < 200; i++)
        boxes[i][3] = boxes[i][4] = boxes[i][5] = i % 2 ? 8 : 1;
    struct canonical_geometry geometry = {.type = GEOMETRY_AABBS, .primitive_count = 200, .boxes = boxes[0]};
    struct canonical canonical = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 200, .geometries = &geometry};
    struct facts facts;
    facts_gather(&canonical, &facts);
    assert_true(fabs(facts.spread - 1.5) < 0.1);
    assert_true(!facts.can_split && facts.slant == 0);
    assert_true(fabs(facts.crossings - 101.5) < 15);
}

/* Nothing to look at, nothing that a ray meets, areas beyond what floats hold. */
static void odd_ones(void **state)
{
    (void)state;
    static float positions[9];
    static const float values[] = {NAN, 0, 1e-45f, 3e38f, INFINITY};
    struct canonical_geometry geometry = {.type = GEOMETRY_TRIANGLES, .primitive_count = 1, .vertex_count = 3, .positions = positions};
    struct canonical canonical = {.type = STRUCTURE_BOTTOM};
    struct facts facts;
    facts_gather(&canonical, &facts);
    assert_true(facts.sampled == 0 && facts.crossings == 0);
    canonical = (struct canonical){.type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 1, .geometries = &geometry};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        for (int k = 0; k < 9; k++)
            positions[k] = k == 3 || k == 7 ? values[i] : 0;
        positions[0] = i == 0 ? NAN : 0;
        facts_gather(&canonical, &facts);
        assert_int_equal(facts.met, i == 2 || i == 3);
        assert_true(facts.crossings == (facts.met ? 1 : 0));
        assert_true(facts.slant >= 0 && facts.slant <= 1 && facts.spread == 0);
    }
}

/* Of every kind, through prepare: whatever strides, formats and indices it came in, the same facts. */
static void of_what_prepare_makes(void **state)
{
    (void)state;
    static void (*const makers[])(struct test_input *) = {inputs_triangles, inputs_aabbs, inputs_instances};
    static const uint32_t met[] = {5, 2, 3};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    struct limits limits = limits_default();
    for (int i = 0; i < 3; i++) {
        struct test_input test;
        struct canonical canonical, opened;
        struct facts facts, again;
        makers[i](&test);
        assert_int_equal(prepare(&test.input, 0, &limits, &context, &canonical, NULL), BVHD_OK);
        facts_gather(&canonical, &facts);
        assert_int_equal(facts.sampled, canonical.primitive_count);
        assert_in_range(facts.met, 1, met[i]);
        assert_int_equal(prepare_open((struct bytes){canonical.bytes, canonical.size}, &memory, &opened, NULL), BVHD_OK);
        facts_gather(&opened, &again);
        assert_memory_equal(&facts, &again, sizeof facts);
        prepare_finish(&opened, &memory);
        prepare_finish(&canonical, &memory);
    }
    assert_int_equal(memory.live, 0);
}

static void logarithms(void **state)
{
    (void)state;
    for (double value = 1e-300; value < 1e300; value *= 1.37) {
        assert_true(fabs(facts_log2(value) - log2(value)) < 0.01);
        assert_true(fabs(facts_exp2(log2(value)) / value - 1) < 0.005);
    }
    for (int i = -1000; i <= 1000; i++)
        assert_true(facts_log2(ldexp(1, i)) == i && facts_exp2(i) == ldexp(1, i));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_flat_grid), cmocka_unit_test(a_slope_slants),        cmocka_unit_test(sizes_spread),
        cmocka_unit_test(odd_ones),    cmocka_unit_test(of_what_prepare_makes), cmocka_unit_test(logarithms),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
