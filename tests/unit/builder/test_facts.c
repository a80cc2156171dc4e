/* SPDX-License-Identifier: Apache-2.0 */
/* test_facts.c - tests that facts_gather() estimates crossings, unevenness and thickness of known scenes. */
#include "tests/support/unit.h"

#include <math.h>
#include <stdlib.h>

#include "builder/facts.h"
#include "tests/support/builder/inputs.h"
#include "builder/input/prepare.h"

/*
 * Makes the triangles of a grid over [0, side] x [0, side] in the plane y = 0, two for each square; `tilt` adds x *
 * tilt to y.
 */
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
    *geometry = (struct canonical_geometry){.type = GEOMETRY_TRIANGLES,
                                            .primitive_count = 2 * side * side,
                                            .vertex_count = 6 * side * side,
                                            .positions = positions};
    return (struct canonical){.type = STRUCTURE_BOTTOM,
                              .geometry_count = 1,
                              .primitive_count = geometry->primitive_count,
                              .geometries = geometry};
}

/*
 * Computes the crossings exactly, from every triangle to every other one: the places in a grid are alike, so a sample
 * must come near.
 */
static double seen_from_all(const struct canonical_geometry *geometry)
{
    double sum = 0;
    uint32_t count = geometry->primitive_count;
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < count; k++) {
            const float *view = geometry->positions + 18 * (size_t)(i / 2),
                        *square = geometry->positions + 18 * (size_t)(k / 2);
            double x = fmax(fabs((double)view[0] - square[0]) - 0.5, 0),
                   z = fmax(fabs((double)view[2] - square[2]) - 0.5, 0);
            sum += i == k ? 0 : 1 / (1 + 8 * M_PI * (x * x + z * z));
        }
    return sum / count;
}

/*
 * A flat grid has no thickness. A ray from a triangle always meets the box of its twin in the same square, and seldom
 * those around.
 */
static void a_flat_grid(void **state)
{
    (void)state;
    static const uint32_t sides[] = {1, 3, 5, 45, 300}, samples[] = {2, 18, 50, 126, FACTS_MOST};
    for (size_t i = 0; i < sizeof sides / sizeof sides[0]; i++) {
        struct canonical_geometry geometry;
        struct canonical canonical = grid(&geometry, sides[i], 0);
        struct facts facts;
        facts_gather(&canonical, &facts);
        assert_int_equal(facts.primitives, 2 * sides[i] * sides[i]);
        assert_int_equal(facts.sampled, samples[i]);
        assert_int_equal(facts.met, facts.sampled);
        assert_true(facts.can_split && facts.thickness == 0 && fabs(facts.unevenness) < 1e-12);
        if (sides[i] <= 5)
            assert_true(fabs(facts.crossings / seen_from_all(&geometry) - 1) < 0.1);
        canonical.flags = i % 2 ? BUILD_ALLOW_UPDATE : BUILD_LOW_MEMORY;
        facts_gather(&canonical, &facts);
        assert_false(facts.can_split);
        canonical.flags = BUILD_MOTION;
        geometry.type = GEOMETRY_MOVING_TRIANGLES;
        facts_gather(&canonical, &facts);
        assert_false(facts.can_split);
        free((void *)(uintptr_t)geometry.positions);
    }
}

/* The grid is tilted so that the sides of its bounds are 20, 5 and 20. */
static void a_slope_is_thick(void **state)
{
    (void)state;
    struct canonical_geometry geometry;
    struct canonical canonical = grid(&geometry, 20, 0.25f);
    struct facts facts;
    facts_gather(&canonical, &facts);
    assert_true(facts.thickness == 0.25);
    free((void *)(uintptr_t)geometry.positions);
}

static struct facts facts_of_boxes(const float *boxes, uint32_t count)
{
    struct canonical_geometry geometry = {.type = GEOMETRY_AABBS, .primitive_count = count, .boxes = boxes};
    struct canonical canonical = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = count, .geometries = &geometry};
    struct facts facts;
    facts_gather(&canonical, &facts);
    assert_false(facts.can_split);
    return facts;
}

/*
 * Returns the share of all directions in which a ray from (0.5, 0.5, 0.5) meets the cube [d, d + 1] x [0, 1] x [0, 1]:
 * it takes directions spread evenly over a sphere and checks where they pass x = d.
 */
static double share_of_directions(double d)
{
    enum { ALL = 400000 };
    uint32_t hits = 0;
    for (uint32_t i = 0; i < ALL; i++) {
        double x = 2 * (i + 0.5) / ALL - 1, angle = i * 2.399963229728653, around = sqrt(1 - x * x);
        double y = around * cos(angle) / x * (d - 0.5), z = around * sin(angle) / x * (d - 0.5);
        hits += x > 0 && fabs(y) <= 0.5 && fabs(z) <= 0.5;
    }
    return (double)hits / ALL;
}

/*
 * The farther apart two cubes are, the less their rays meet. Seen face to face, a cube shows two thirds of what it
 * shows on average.
 */
static void what_is_far_is_seldom_met(void **state)
{
    (void)state;
    for (double d = 2; d <= 16; d *= 2) {
        float boxes[2][6] = {{0, 0, 0, 1, 1, 1}, {(float)d, 0, 0, (float)d + 1, 1, 1}};
        struct facts facts = facts_of_boxes(boxes[0], 2);
        assert_true(fabs(facts.crossings - 3 / (3 + 8 * M_PI * (d - 0.5) * (d - 0.5))) < 1e-9);
        assert_true(fabs(facts.crossings * 2 / 3 / share_of_directions(d) - 1) < 0.1);
        assert_true(fabs(facts.thickness - 1 / (d + 1)) < 1e-6);
    }
}

/* Boxes that surround all others are met by every ray; a sample's crossings are scaled to the whole structure. */
static void what_is_around_is_met(void **state)
{
    (void)state;
    static float boxes[4000][6];
    for (int i = 0; i < 4000; i++)
        for (int axis = 0; axis < 3; axis++) {
            boxes[i][axis] = i % 4 ? (float)(i * 7919 % 997) : -1;
            boxes[i][3 + axis] = i % 4 ? boxes[i][axis] + 1e-3f : 1000;
        }
    assert_true(facts_of_boxes(boxes[0], 4000).crossings > 900);
    assert_true(facts_of_boxes(boxes[0], 4000).crossings < 1100);
    /* a quarter of the boxes has all the area */
    assert_true(fabs(facts_of_boxes(boxes[0], 4000).unevenness - 0.75) < 0.05);
    for (int i = 0; i < 4000; i++)
        for (int k = 0; k < 6; k++)
            boxes[i][k] = k / 3;
    for (uint32_t count = 1; count <= 4000; count = 3 * count - 1 + (count == 1))
        assert_true(fabs(facts_of_boxes(boxes[0], count).crossings / (count - 1 + (count == 1)) - (count > 1)) < 0.02);
}

/* Handles structures without primitives, without any that a ray can meet, and with areas that floats cannot hold. */
static void odd_ones(void **state)
{
    (void)state;
    static float positions[18];
    static const float values[] = {NAN, 0, 1e-45f, 3e38f, INFINITY};
    struct canonical_geometry geometry = {
        .type = GEOMETRY_TRIANGLES, .primitive_count = 2, .vertex_count = 6, .positions = positions};
    struct canonical canonical = {.type = STRUCTURE_BOTTOM};
    struct facts facts;
    facts_gather(&canonical, &facts);
    assert_true(facts.sampled == 0 && facts.crossings == 0 && facts.thickness == 0 && facts.unevenness == 0);
    canonical = (struct canonical){
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 2, .geometries = &geometry};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        for (int k = 0; k < 18; k++)
            positions[k] = k % 9 == 3 || k % 9 == 7 ? values[i] : 0;
        positions[0] = positions[9] = i == 0 ? NAN : 0;
        facts_gather(&canonical, &facts);
        assert_int_equal(facts.met, i == 2 || i == 3 ? 2 : 0);
        assert_true(facts.crossings == (i == 3) || (i == 2 && facts.crossings <= 1));
        assert_true(facts.thickness == 0 && fabs(facts.unevenness) < 1e-12); /* two equal triangles, or none */
    }
}

/* A canonical copy of each kind of geometry gives the same facts as the copy that is opened from its bytes. */
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
        assert_int_equal(prepare_open((struct bytes){canonical.bytes, canonical.size}, &memory, &opened, NULL),
                         BVHD_OK);
        facts_gather(&opened, &again);
        assert_true(facts.primitives == again.primitives && facts.sampled == again.sampled && facts.met == again.met &&
                    facts.can_split == again.can_split);
        assert_true(facts.crossings == again.crossings && facts.thickness == again.thickness &&
                    facts.unevenness == again.unevenness);
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
        cmocka_unit_test(a_flat_grid),
        cmocka_unit_test(a_slope_is_thick),
        cmocka_unit_test(what_is_far_is_seldom_met),
        cmocka_unit_test(what_is_around_is_met),
        cmocka_unit_test(odd_ones),
        cmocka_unit_test(of_what_prepare_makes),
        cmocka_unit_test(logarithms),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
