/* SPDX-License-Identifier: Apache-2.0 */
/* test_latency.c - tests percentiles of times against sorted lists of the same times, and which times are recent. */
#include "tests/support/unit.h"

#include <stdlib.h>

#include "daemon/service/latency.h"
#include "tests/support/random.h"

enum { MANY = 5000 };

static int compare(const void *a, const void *b)
{
    uint64_t left = *(const uint64_t *)a, right = *(const uint64_t *)b;
    return left < right ? -1 : left > right;
}

/* The value is the true one, or higher by at most an eighth. */
static void check(uint64_t got, const uint64_t *sorted, uint64_t count, unsigned percent)
{
    uint64_t want = sorted[(count * percent + 99) / 100 - 1];
    assert_in_range(got, want, want + want / 8);
}

static void percentiles_are_those_of_the_times(void **state)
{
    (void)state;
    struct random random = {7};
    for (unsigned bits = 1; bits <= LATENCY_POWERS; bits++) {
        static uint64_t times[MANY];
        struct latency latency = {0};
        uint64_t count = 1 + random_next(&random) % MANY, sum = 0;
        for (uint64_t i = 0; i < count; i++) {
            times[i] = random_next(&random) >> (64 - bits) >> random_next(&random) % bits;
            latency_add(&latency, 1, times[i] * 1000 + 999);
            sum += times[i];
        }
        qsort(times, count, sizeof *times, compare);
        struct latency_summary summary = latency_summary(&latency, 1);
        assert_int_equal(summary.count, count);
        assert_int_equal(summary.most_us, times[count - 1]);
        check(summary.p50_us, times, count, 50);
        check(summary.p90_us, times, count, 90);
        check(summary.p99_us, times, count, 99);
        assert_int_equal(latency.count, count);
        assert_int_equal(latency.sum_us, sum);
    }
}

static void powers_hold_every_time(void **state)
{
    (void)state;
    struct latency latency = {0};
    for (unsigned i = 0; i < LATENCY_POWERS; i++) {
        latency_add(&latency, 1, (UINT64_C(1) << i) * 1000);
        latency_add(&latency, 1, ((UINT64_C(2) << i) - 1) * 1000);
    }
    latency_add(&latency, 1, 0);
    latency_add(&latency, 1, UINT64_MAX);
    for (unsigned i = 0; i < LATENCY_POWERS; i++)
        assert_int_equal(latency.powers[i], i == 0 || i == LATENCY_POWERS - 1 ? 3 : 2);
    assert_int_equal(latency_summary(&latency, 1).most_us, (UINT64_C(1) << LATENCY_POWERS) - 1);
}

static void old_times_are_forgotten(void **state)
{
    (void)state;
    const uint64_t period = LATENCY_PERIOD_NS, start = 1000 * period;
    struct latency latency = {0};
    assert_int_equal(latency_summary(&latency, start).count, 0);
    assert_int_equal(latency_summary(&latency, start).p99_us, 0);
    latency_add(&latency, start, 5000);
    assert_int_equal(latency_summary(&latency, start + 2 * period - 1).p50_us, 5);
    assert_int_equal(latency_summary(&latency, start + 2 * period).count, 0);
    latency_add(&latency, start + period, 7000);
    assert_int_equal(latency_summary(&latency, start + period).count, 2);
    assert_int_equal(latency_summary(&latency, start + period).p50_us, 5);
    assert_int_equal(latency_summary(&latency, start + 2 * period).p50_us, 7);
    latency_add(&latency, start + 9 * period, 6000);
    assert_int_equal(latency_summary(&latency, start + 9 * period).count, 1);
    assert_int_equal(latency_summary(&latency, start + 9 * period).most_us, 6);
    assert_int_equal(latency.count, 3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(percentiles_are_those_of_the_times),
        cmocka_unit_test(powers_hold_every_time),
        cmocka_unit_test(old_times_are_forgotten),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
