/* SPDX-License-Identifier: Apache-2.0 */
/* test_exposure.c - tests the histogram of a picture's light and the exposure that follows from it. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/picture/exposure.h"

static void test_percentiles(void **state)
{
    (void)state;
    struct histogram histogram = {{0}, 0};
    assert_true(histogram_percentile(&histogram, 0.5) == 0);
    for (int i = 1; i <= 1000; i++)
        histogram_add(&histogram, i * 0.001);
    for (double fraction = 0.1; fraction < 1; fraction += 0.1)
        assert_true(fabs(histogram_percentile(&histogram, fraction) / fraction - 1) < 0.05);
}

/* Values that no light has are counted as the darkest or the brightest one. */
static void test_extremes(void **state)
{
    (void)state;
    struct histogram histogram = {{0}, 0};
    histogram_add(&histogram, NAN);
    histogram_add(&histogram, -1);
    histogram_add(&histogram, 0);
    assert_int_equal(histogram.bins[0], 3);
    histogram_add(&histogram, INFINITY);
    histogram_add(&histogram, 1e30);
    assert_int_equal(histogram.bins[EXPOSURE_BINS - 1], 2);
}

static double choose(double most, double few, bool is_inside)
{
    struct histogram histogram = {{0}, 0};
    for (int i = 0; i < 1000; i++)
        histogram_add(&histogram, i < 990 ? most : few);
    return exposure_choose(&histogram, is_inside);
}

/* White bodies become darker, dark ones a little brighter; a few bright pixels decide nothing. */
static void test_choice(void **state)
{
    (void)state;
    struct histogram nothing = {{0}, 0};
    assert_true(exposure_choose(&nothing, false) == 1);
    double white = choose(2.3, 2.3, false), grey = choose(1.1, 1.1, false), black = choose(0.01, 0.01, false);
    assert_true(white * 2.3 < 1.3 && white < 0.6);
    assert_true(fabs(grey - 1) < 0.15);
    assert_true(black > 1.2 && black < 2.5);
    assert_true(choose(1.1, 500, false) == grey);
    double dim = choose(0.02, 0.02, true), bright = choose(0.1, 0.1, true);
    assert_true(dim > bright && dim <= 8 && bright > 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_percentiles),
        cmocka_unit_test(test_extremes),
        cmocka_unit_test(test_choice),
    };
    return cmocka_run_group_tests_name("exposure", tests, NULL, NULL);
}
