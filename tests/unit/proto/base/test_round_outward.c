/* SPDX-License-Identifier: Apache-2.0 */
/* test_round_outward.c - tests the rounding of bounds against the floats beside them. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "proto/base/round_outward.h"
#include "tests/support/random.h"

/* The float below or above is tried first, so that the result is the nearest one that is allowed. */
static void check(double value)
{
    const float down = round_down(value), up = round_up(value);
    assert_true(down <= value && up >= value);
    if ((double)down != value)
        assert_true(nextafterf(down, INFINITY) > value);
    if ((double)up != value)
        assert_true(nextafterf(up, -INFINITY) < value);
}

static void test_special(void **state)
{
    (void)state;
    const double values[] = {0,       -0.0,     DBL_MIN,  -DBL_MIN,      FLT_MIN / 3.0, -FLT_MIN / 3.0, 1,   -1,
                             FLT_MAX, -FLT_MAX, INFINITY, 2.0 * FLT_MAX, DBL_MAX,       -DBL_MAX,       0.1, -0.1};
    for (size_t i = 0; i < sizeof values / sizeof *values; i++)
        check(values[i]);
    assert_true(round_down(DBL_MAX) == FLT_MAX && round_up(-DBL_MAX) == -FLT_MAX && round_up(-INFINITY) == -INFINITY);
    assert_true(isnan(round_down(NAN)) && isnan(round_up(NAN)));
}

static void test_random(void **state)
{
    (void)state;
    struct random random = {1};
    for (int i = 0; i < 1000000; i++)
        check(ldexp(random_between(&random, -1, 1), (int)random_between(&random, -160, 140)));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_special),
        cmocka_unit_test(test_random),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
