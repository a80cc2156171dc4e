/* SPDX-License-Identifier: Apache-2.0 */
/* test_largest.c - tests the largest of numbers that come and go, against a list of them. */
#include <stdbool.h>

#include "tests/support/unit.h"

#include "daemon/service/largest.h"
#include "tests/support/random.h"

static void test_buckets_are_narrow_and_in_order(void **state)
{
    (void)state;
    struct random random = {3};
    assert_int_equal(largest_bucket(UINT64_MAX), LARGEST_BUCKETS - 2 * LARGEST_STEPS - 1);
    assert_true(largest_of_bucket(largest_bucket(UINT64_MAX)) == UINT64_MAX);
    for (int i = 0; i < 100000; i++) {
        uint64_t number = random_next(&random) >> (random_next(&random) % 64);
        uint32_t bucket = largest_bucket(number);
        assert_true(bucket < LARGEST_BUCKETS && number <= largest_of_bucket(bucket));
        assert_true(largest_of_bucket(bucket) - number <= number / LARGEST_STEPS);
        assert_true(bucket == 0 || largest_of_bucket(bucket - 1) < number);
    }
}

static void test_the_largest_of_many_is_known(void **state)
{
    (void)state;
    enum { NUMBERS = 50 };
    static struct largest largest;
    uint64_t numbers[NUMBERS] = {0};
    bool is_there[NUMBERS] = {false};
    struct random random = {4};
    assert_int_equal(largest_get(&largest), 0);
    for (int step = 0; step < 20000; step++) {
        uint64_t at = random_next(&random) % NUMBERS, most = 0;
        if (is_there[at]) {
            largest_remove(&largest, numbers[at]);
        } else {
            numbers[at] = random_next(&random) >> (random_next(&random) % 64);
            largest_add(&largest, numbers[at]);
        }
        is_there[at] = !is_there[at];
        for (int i = 0; i < NUMBERS; i++)
            most = is_there[i] && numbers[i] > most ? numbers[i] : most;
        assert_true(largest_get(&largest) >= most && largest_get(&largest) - most <= most / LARGEST_STEPS);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_buckets_are_narrow_and_in_order),
        cmocka_unit_test(test_the_largest_of_many_is_known),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
