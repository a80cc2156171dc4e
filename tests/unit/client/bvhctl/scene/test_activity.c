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

/* A triangle that moves is without area only if it is so for sure at all times. */
static void test_moving(void **state)
{
    (void)state;
    float starts[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 2, 0, 0, 3, 0, 0, 0, 0, 0};
    float ends[] = {0, 0, 1, 1, 0, 1, 0, 1, 1, 2, 0, 1, NAN, 0, 0, INFINITY, 0, 0};
    uint32_t indices[] = {
        0, 1, 2, /* active */
        1, 1, 2, /* without area: a repeated corner */
        0, 1, 3, /* without area: on a line along an axis at both ends */
        0, 1, 4, /* inactive at the end */
        0, 1, 5, /* infinite at the end */
        0, 5, 2, /* infinite at the end, although it has no area at the start */
    };
    const struct import_mesh mesh = {
        .positions = starts, .end_positions = ends, .indices = indices, .vertex_count = 6, .primitive_count = 6};
    struct activity activity = activity_of(&mesh);
    assert_int_equal(activity.degenerate, 2);
    assert_int_equal(activity.inactive, 1);
    assert_int_equal(activity.infinite, 2);
    starts[3 * 3 + 1] = 1e-3f; /* off the line at the start alone */
    assert_int_equal(activity_of(&mesh).degenerate, 1);
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
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_kinds), cmocka_unit_test(test_moving),
                                       cmocka_unit_test(test_empty)};
    return cmocka_run_group_tests_name("activity", tests, NULL, NULL);
}
