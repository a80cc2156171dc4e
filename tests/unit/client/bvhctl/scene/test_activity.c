/* SPDX-License-Identifier: Apache-2.0 */
/* test_activity.c - tests that triangles that no ray can hit are counted by kind, once each. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/scene/activity.h"

static void test_kinds(void **state)
{
    (void)state;
    float positions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 2, 0, 0, NAN, 0, 0, 0, 0, INFINITY, 0, NAN, INFINITY};
    uint32_t indices[] = {
        0, 1, 2, /* active */
        0, 1, 3, /* without area: in a line */
        1, 1, 2, /* without area: a repeated corner */
        0, 1, 4, /* inactive */
        1, 1, 4, /* inactive, even with a repeated corner */
        0, 1, 5, /* infinite */
        5, 5, 5, /* infinite */
        0, 1, 6, /* inactive before infinite */
    };
    const struct import_mesh mesh = {
        .positions = positions, .indices = indices, .vertex_count = 7, .primitive_count = 8};
    struct activity activity = activity_of(&mesh);
    assert_int_equal(activity.degenerate, 2);
    assert_int_equal(activity.inactive, 3);
    assert_int_equal(activity.infinite, 2);
}

static void test_empty(void **state)
{
    (void)state;
    const struct import_mesh mesh = {0};
    struct activity activity = activity_of(&mesh);
    assert_int_equal(activity.degenerate + activity.inactive + activity.infinite, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_kinds), cmocka_unit_test(test_empty)};
    return cmocka_run_group_tests_name("activity", tests, NULL, NULL);
}
