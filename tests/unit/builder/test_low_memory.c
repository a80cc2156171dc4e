/* SPDX-License-Identifier: Apache-2.0 */
/* test_low_memory.c - tests the memory that a build with LOW_MEMORY takes against the bound in bvhd_structure.h. */
#include "tests/support/unit.h"

#include "builder/batch.h"
#include "tests/support/random.h"

enum { LARGEST = 8000, FIXED = 65536, BYTES_A_TRIANGLE = 320 };

static float corners[LARGEST][3][3];

/* Makes triangles that overlap a lot, so that spatial splits would pay. */
static void make_triangles(void)
{
    struct random random = {3};
    for (uint32_t i = 0; i < LARGEST; i++) {
        float centre[3];
        for (int axis = 0; axis < 3; axis++)
            centre[axis] = (float)random_between(&random, -1, 1);
        for (int k = 0; k < 9; k++)
            corners[i][k / 3][k % 3] = centre[k % 3] + (float)random_between(&random, -0.3, 0.3);
    }
}

/* Returns the peak of a build on one thread, with its result. */
static uint64_t peak_of(uint32_t count, uint32_t flags, enum build_quality quality, enum target target)
{
    struct memory memory;
    struct bvhd_error error;
    struct batch_item item;
    memory_init(&memory, UINT64_MAX);
    const struct limits limits = limits_default();
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    const struct geometry geometry = {.type = GEOMETRY_TRIANGLES,
                                      .triangles = {.vertex_format = 106,
                                                    .max_vertex = 3 * count - 1,
                                                    .vertex_stride = 12,
                                                    .index_type = INDEX_NONE,
                                                    .vertices = {(const unsigned char *)corners, (uint64_t)36 * count}},
                                      .range = {.primitive_count = count}};
    const struct build_input input = {
        .type = STRUCTURE_BOTTOM,
        .flags = flags,
        .geometry_count = 1,
        .geometries = &geometry,
        .options = {.quality = quality, .target = target, .device.variant = target == TARGET_LAVAPIPE}};
    assert_int_equal(batch_build(&input, 1, &limits, &context, &item, &error), BVHD_OK);
    if (item.status != BVHD_OK)
        fail_msg("%s: %s", item.error.where, item.error.text);
    batch_finish(&item, 1, &memory);
    return memory.peak;
}

static void the_bound_holds(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 100, 2000, LARGEST};
    make_triangles();
    for (int i = 0; i < 4 * 3 * 2; i++) {
        const uint32_t count = counts[i / 6];
        const enum build_quality quality = (enum build_quality)(QUALITY_FAST + i / 2 % 3);
        const enum target target = i % 2 ? TARGET_LAVAPIPE : TARGET_PORTABLE;
        const uint64_t peak = peak_of(count, BUILD_LOW_MEMORY, quality, target),
                       plain = peak_of(count, 0, quality, target);
        assert_true(quality == QUALITY_HIGH && count > 1 ? peak < plain : peak <= plain);
        assert_true(peak <= FIXED + (uint64_t)BYTES_A_TRIANGLE * count);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(the_bound_holds)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
