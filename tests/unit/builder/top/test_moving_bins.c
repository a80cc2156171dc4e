/* SPDX-License-Identifier: Apache-2.0 */
/* test_moving_bins.c - tests the division of refs by the boxes of both ends. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/top/moving_bins.h"
#include "tests/support/random.h"

enum { COUNT = 300 };

/* A cube with the side 1 at two places. */
static struct moving_ref cube(const double start[3], const double end[3], uint32_t place)
{
    struct box boxes[2];
    for (int axis = 0; axis < 3; axis++) {
        boxes[0].min[axis] = (float)start[axis];
        boxes[0].max[axis] = (float)(start[axis] + 1);
        boxes[1].min[axis] = (float)end[axis];
        boxes[1].max[axis] = (float)(end[axis] + 1);
    }
    return moving_ref_of(boxes, place);
}

/* Two groups that are apart along one axis at one end only are parted exactly, whatever their order. */
static void groups_are_parted(void **state)
{
    (void)state;
    struct random random = {3};
    struct moving_ref refs[COUNT];
    for (int key = 0; key < 2; key++)
        for (int apart = 0; apart < 3; apart++) {
            bool is_far[COUNT], seen[COUNT] = {false};
            uint32_t far = 0;
            for (uint32_t i = 0; i < COUNT; i++) {
                double at[2][3];
                random_point(&random, at[0]);
                random_point(&random, at[1]);
                is_far[i] = random_next(&random) % 3 == 0;
                at[key][apart] += is_far[i] ? 100 : 0;
                far += is_far[i];
                refs[i] = cube(at[0], at[1], i);
            }
            const uint32_t left = moving_bins_divide(refs, COUNT);
            assert_int_equal(left, COUNT - far);
            for (uint32_t i = 0; i < COUNT; i++) {
                assert_false(seen[refs[i].place]);
                seen[refs[i].place] = true;
                assert_int_equal(is_far[refs[i].place], i >= left);
            }
        }
}

/* Without a plane refs are halved, also where they are so near each other that floats cannot tell. */
static void equal_refs_are_halved(void **state)
{
    (void)state;
    const double at[2][3] = {{1, 2, 3}, {4, 5, 6}};
    struct moving_ref refs[7];
    for (uint32_t i = 0; i < 7; i++)
        refs[i] = cube(at[0], at[1], i);
    assert_int_equal(moving_bins_divide(refs, 7), 3);
    for (uint32_t i = 0; i < 7; i++)
        assert_int_equal(refs[i].place, i);
    const struct box points[2] = {{{0, 0, 0}, {0, 0, 0}}, {{0x1p-149f, 0, 0}, {0x1p-149f, 0, 0}}};
    for (uint32_t i = 0; i < 2; i++)
        refs[i] = moving_ref_of(&(const struct box[2]){points[i], points[i]}[0], i);
    assert_int_equal(moving_bins_divide(refs, 2), 1);
}

/* Both sides always have refs, also of extreme magnitudes. */
static void both_sides_have_refs(void **state)
{
    (void)state;
    struct random random = {9};
    struct moving_ref refs[COUNT];
    for (int turn = 0; turn < 2000; turn++) {
        const uint32_t count = 2 + random_next(&random) % (turn % 10 ? 10 : COUNT - 2);
        for (uint32_t i = 0; i < count; i++) {
            double at[2][3];
            for (int key = 0; key < 2; key++)
                for (int axis = 0; axis < 3; axis++)
                    at[key][axis] = ldexp(random_between(&random, -1, 1), (int)(random_next(&random) % 79) - 39);
            refs[i] = cube(at[0], at[1], i);
        }
        const uint32_t left = moving_bins_divide(refs, count);
        assert_true(left >= 1 && left < count);
    }
}

static void boxes_are_summed_up(void **state)
{
    (void)state;
    const double here[3] = {0, 0, 0}, there[3] = {2, 0, 0};
    struct moving_ref ref = cube(here, there, 0);
    const struct moving_ref other = cube(there, there, 1);
    assert_true(moving_ref_area(&ref) == 6);
    moving_ref_grow(&ref, &other); /* 3 x 1 x 1 at the start */
    assert_true(moving_ref_area(&ref) == 7 + 3);
    moving_ref_unite(&ref);
    assert_true(moving_ref_area(&ref) == 7 + 7);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(groups_are_parted),
        cmocka_unit_test(equal_refs_are_halved),
        cmocka_unit_test(both_sides_have_refs),
        cmocka_unit_test(boxes_are_summed_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
