/* SPDX-License-Identifier: Apache-2.0 */
/* test_prefix.c - tests that every number is found in the range that contains it, also beside empty ranges. */
#include "tests/support/unit.h"

#include "proto/base/prefix.h"
#include "tests/support/random.h"

enum { MOST = 12 };

struct range {
    uint32_t unrelated, first, count;
};

static uint32_t find(const struct range *ranges, uint32_t count, uint64_t number)
{
    return prefix_find(&ranges[0].first, sizeof ranges[0], count, number);
}

static void every_number_is_in_its_range(void **state)
{
    (void)state;
    struct random random = {3};
    for (int round = 0; round < 500; round++) {
        struct range ranges[MOST] = {0};
        uint32_t count = 1 + (uint32_t)(random_next(&random) % MOST), sum = 0;
        for (uint32_t i = 0; i < count; i++) {
            ranges[i] = (struct range){UINT32_MAX, sum, (uint32_t)(random_next(&random) % 4)};
            sum += ranges[i].count;
        }
        for (uint32_t number = 0; number < sum; number++) {
            const struct range *found = &ranges[find(ranges, count, number)];
            assert_true(found->first <= number && number - found->first < found->count);
        }
    }
}

static void numbers_reach_their_largest(void **state)
{
    (void)state;
    const struct range ranges[] = {{0, 0, 1}, {0, 1, UINT32_MAX - 1}, {0, UINT32_MAX, 1}};
    assert_int_equal(find(ranges, 3, 0), 0);
    assert_int_equal(find(ranges, 3, 1), 1);
    assert_int_equal(find(ranges, 3, UINT32_MAX - 1), 1);
    assert_int_equal(find(ranges, 3, UINT32_MAX), 2);
    assert_int_equal(find(ranges, 3, UINT64_C(1) << 32), 2);
}

static void no_range_gives_zero(void **state)
{
    (void)state;
    assert_int_equal(prefix_find(NULL, sizeof(struct range), 0, 5), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_number_is_in_its_range),
        cmocka_unit_test(numbers_reach_their_largest),
        cmocka_unit_test(no_range_gives_zero),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
