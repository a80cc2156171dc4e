/* SPDX-License-Identifier: Apache-2.0 */
/* test_oracle_hull.c - tests the oracle's search against many samples, and against cases whose answers are known. */
#include "tests/support/unit.h"

#include <math.h>
#include <stdbool.h>

#include "client/bvhctl/oracle/oracle_hull.h"
#include "tests/support/random.h"

enum { HULLS = 3000, SAMPLES = 200 };

/* Makes spheres of similar sizes, of which one may contain the other, next to a line. */
static struct oracle_hull make_hull(struct random *random)
{
    struct oracle_hull hull;
    for (int end = 0; end < 2; end++) {
        hull.across[end][2] = 0;
        hull.across[end][0] = random_between(random, -1, 1);
        hull.across[end][1] = random_between(random, -1, 1);
        hull.along[end] = random_between(random, -2, 2);
        hull.radius[end] = random_between(random, 0, 1.5);
    }
    return hull;
}

static void no_sample_is_better_than_what_is_found(void **state)
{
    (void)state;
    struct random random = {4};
    int met = 0, inner = 0;
    for (int i = 0; i < HULLS; i++) {
        const struct oracle_hull hull = make_hull(&random);
        const double nearest = oracle_hull_nearest(&hull), first = oracle_hull_first(&hull);
        const double gap = oracle_hull_gap(&hull, nearest), entry = oracle_hull_entry(&hull, first);
        const bool is_met = gap <= 0;
        assert_true(nearest >= 0 && nearest <= 1 && first >= 0 && first <= 1);
        assert_true(is_met == (oracle_hull_gap(&hull, first) <= 0) || fabs(gap) < 1e-12);
        for (int k = 0; k <= SAMPLES; k++) {
            const double z = (double)k / SAMPLES;
            assert_true(oracle_hull_gap(&hull, z) >= gap - 1e-12);
            if (is_met && oracle_hull_gap(&hull, z) <= 0)
                assert_true(oracle_hull_entry(&hull, z) >= entry - 1e-12);
        }
        met += is_met;
        inner += is_met && first > 0 && first < 1;
    }
    assert_true(met > HULLS / 3 && met < HULLS && inner > HULLS / 20);
}

static void known_hulls(void **state)
{
    (void)state;
    const struct oracle_hull upright = {{{-2, 0, 0}, {2, 0, 0}}, {5, 5}, {1, 1}},
                             lying = {{{0, 0.5, 0}, {0, 0.5, 0}}, {7, 3}, {1, 1}},
                             aside = {{{-1, 3, 0}, {1, 3, 0}}, {0, 0}, {1, 1}},
                             one = {{{0, 0.6, 0}, {0, 0.6, 0}}, {4, 4}, {1, 1}};
    assert_float_equal(oracle_hull_first(&upright), 0.5, 1e-6);
    assert_float_equal(oracle_hull_entry(&upright, 0.5), 4, 1e-12);
    assert_float_equal(oracle_hull_gap(&upright, 0.5), -1, 1e-12);
    assert_true(oracle_hull_first(&lying) == 1);
    assert_float_equal(oracle_hull_entry(&lying, 1), 3 - sqrt(0.75), 1e-12);
    assert_float_equal(oracle_hull_first(&aside), 0.5, 1e-6);
    assert_float_equal(oracle_hull_gap(&aside, 0.5), 2, 1e-12);
    assert_float_equal(oracle_hull_entry(&one, oracle_hull_first(&one)), 3.2, 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_sample_is_better_than_what_is_found),
        cmocka_unit_test(known_hulls),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
