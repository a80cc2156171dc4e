/* SPDX-License-Identifier: Apache-2.0 */
/* test_micromap_read.c - tests that a program reads a micromap's numbers and indices, and no damaged micromap. */
#include "tests/support/unit.h"

#include <stdint.h>

#include <bvhd/bvhd_micromap.h>

#include "builder/format/portable_micromap.h"
#include "proto/base/geometry.h"

enum { TRIANGLES = 4, STATES = 22, INDICES = 6 };

static const struct micromap_triangle triangles[TRIANGLES] = {
    {0, 2, MICRO_4_STATE}, {4, 3, MICRO_4_STATE}, {20, 0, MICRO_2_STATE}, {21, 0, MICRO_2_STATE}};
static const uint32_t indices[INDICES] = {3, 1, MICROMAP_FULLY_OPAQUE, 1, 1, MICROMAP_FULLY_UNKNOWN_OPAQUE};

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

/* Writes a micromap, which the caller frees. */
static unsigned char *make(uint32_t index_count, uint64_t *ret_size)
{
    static const unsigned char states[STATES] = {1, 2, 3};
    struct layout_micromap input = {.triangles = triangles,
                                    .triangle_count = TRIANGLES,
                                    .states = states,
                                    .states_size = STATES,
                                    .indices = index_count > 0 ? indices : NULL,
                                    .index_count = index_count,
                                    .memory = &memory};
    for (uint32_t i = 0; index_count > 0 && i < MICRO_STATES; i++)
        input.baked[i] = i + 5;
    unsigned char *blob;
    struct layout_sizes sizes;
    assert_int_equal(portable_micromap_write(&input, &blob, &sizes, NULL), BVHD_OK);
    *ret_size = sizes.total;
    return blob;
}

static void expect_usage(const VkMicromapUsageEXT *usage, uint32_t count, uint32_t level, uint32_t format)
{
    assert_int_equal(usage->count, count);
    assert_int_equal(usage->subdivisionLevel, level);
    assert_int_equal(usage->format, format);
}

static void a_baked_micromap_is_read(void **state)
{
    (void)state;
    struct bvhd_micromap micromap = {.struct_size = sizeof micromap};
    uint64_t size;
    unsigned char *blob = make(INDICES, &size);
    assert_int_equal(bvhd_micromap_read(blob, size, &micromap, NULL), BVHD_OK);
    assert_int_equal(micromap.triangle_count, TRIANGLES);
    assert_int_equal(micromap.states_size, STATES);
    assert_int_equal(micromap.index_count, INDICES);
    assert_memory_equal(micromap.indices, indices, sizeof indices);
    for (uint32_t i = 0; i < MICRO_STATES; i++)
        assert_int_equal(micromap.baked[i], i + 5);
    assert_int_equal(micromap.usage_count, 3);
    expect_usage(&micromap.usages[0], 2, 0, MICRO_2_STATE);
    expect_usage(&micromap.usages[1], 1, 2, MICRO_4_STATE);
    expect_usage(&micromap.usages[2], 1, 3, MICRO_4_STATE);
    assert_int_equal(micromap.named_usage_count, 2);
    expect_usage(&micromap.named_usages[0], 1, 0, MICRO_2_STATE);
    expect_usage(&micromap.named_usages[1], 3, 3, MICRO_4_STATE);
    memory_free(&memory, blob);
}

static void other_micromaps_have_no_indices(void **state)
{
    (void)state;
    struct bvhd_micromap micromap = {.struct_size = sizeof micromap, .index_count = 7, .baked = {1}};
    uint64_t size;
    unsigned char *blob = make(0, &size);
    assert_int_equal(bvhd_micromap_read(blob, size, &micromap, NULL), BVHD_OK);
    assert_int_equal(micromap.usage_count, 3);
    assert_int_equal(micromap.index_count, 0);
    assert_null(micromap.indices);
    assert_int_equal(micromap.baked[0], 0);
    assert_int_equal(micromap.named_usage_count, 0);
    memory_free(&memory, blob);
}

static void wrong_calls_fail(void **state)
{
    (void)state;
    struct bvhd_micromap micromap = {.struct_size = sizeof micromap, .triangle_count = 77};
    struct bvhd_error error;
    uint64_t size;
    unsigned char *blob = make(INDICES, &size);
    assert_int_equal(bvhd_micromap_read(NULL, size, &micromap, &error), BVHD_INVALID);
    assert_string_equal(error.where, "data");
    assert_int_equal(bvhd_micromap_read(blob, size, NULL, &error), BVHD_INVALID);
    assert_string_equal(error.where, "ret_micromap");
    assert_int_equal(bvhd_micromap_read(blob + 4, size - 4, &micromap, &error), BVHD_INVALID);
    assert_string_equal(error.where, "data");
    assert_int_equal(bvhd_micromap_read(blob, size - 16, &micromap, &error), BVHD_CORRUPT);
    assert_int_not_equal(bvhd_micromap_read(blob, 0, &micromap, &error), BVHD_OK);
    micromap.struct_size = 8;
    assert_int_equal(bvhd_micromap_read(blob, size, &micromap, &error), BVHD_INVALID);
    assert_string_equal(error.where, "ret_micromap.struct_size");
    assert_int_equal(micromap.triangle_count, 77);
    memory_free(&memory, blob);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_baked_micromap_is_read),
        cmocka_unit_test(other_micromaps_have_no_indices),
        cmocka_unit_test(wrong_calls_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
