/* SPDX-License-Identifier: Apache-2.0 */
/* test_result_summary.c - tests that programs see every field of a summary, and that no other field is changed. */
#include "tests/support/unit.h"

#include "client/result_summary.h"

static void every_field_is_shown(void **state)
{
    (void)state;
    struct summary summary = {.primitives = 1,
                              .triangles = 2,
                              .instances = 3,
                              .inactive = 4,
                              .degenerate = 5,
                              .skipped = 6,
                              .refs = 7,
                              .peak_bytes = UINT64_MAX,
                              .depth = 8,
                              .target = BVHD_TARGET_LAVAPIPE,
                              .quality = BVHD_QUALITY_HIGH,
                              .refits = 9,
                              .sah = 10,
                              .decay = 11,
                              .build_ms = 12,
                              .method = "refit",
                              .bounds = {{13, 14, 15}, {16, 17, 18}}};
    for (int i = 0; i < SLABS_COUNT; i++) {
        summary.slabs.min[i] = (float)(100 + i);
        summary.slabs.max[i] = (float)(100 + SLABS_COUNT + i);
    }
    struct bvhd_result result = {.size = 20, .origin = BVHD_ORIGIN_DISK, .queued_ms = 21, .build_ms = 22};
    result_summary_copy(&summary, &result);
    assert_int_equal(result.primitives, 1);
    assert_int_equal(result.triangles, 2);
    assert_int_equal(result.instances, 3);
    assert_int_equal(result.inactive, 4);
    assert_int_equal(result.degenerate, 5);
    assert_int_equal(result.skipped, 6);
    assert_int_equal(result.refs, 7);
    assert_true(result.peak_bytes == UINT64_MAX);
    assert_int_equal(result.depth, 8);
    assert_int_equal(result.target, BVHD_TARGET_LAVAPIPE);
    assert_int_equal(result.quality, BVHD_QUALITY_HIGH);
    assert_int_equal(result.refits, 9);
    assert_true(result.sah == 10 && result.decay == 11 && result.original_build_ms == 12);
    assert_ptr_equal(result.method, summary.method);
    for (int i = 0; i < 6; i++)
        assert_true(result.bounds[i] == (float)(13 + i));
    for (int i = 0; i < 2 * SLABS_COUNT; i++)
        assert_true(result.slabs[i] == (float)(100 + i));
    assert_int_equal(result.size, 20);
    assert_int_equal(result.origin, BVHD_ORIGIN_DISK);
    assert_true(result.queued_ms == 21 && result.build_ms == 22);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_field_is_shown),
    };
    return cmocka_run_group_tests_name("result_summary", tests, NULL, NULL);
}
