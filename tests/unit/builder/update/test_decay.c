/* SPDX-License-Identifier: Apache-2.0 */
/* test_decay.c - tests that the decay at which building pays follows from the quality and the number of rays. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/update/decay.h"

static const enum build_quality qualities[] = {QUALITY_FAST, QUALITY_BALANCED, QUALITY_HIGH};

/* The more rays there are, the less decay is worth a build; a tree that has not decayed is never built again. */
static void test_rays(void **state)
{
    (void)state;
    for (int i = 0; i < 3; i++) {
        double last = INFINITY;
        for (double rays = 0.001; rays < 1e6; rays *= 2) {
            const double decay = decay_to_rebuild(qualities[i], rays);
            assert_true(isfinite(decay) && decay > 1 && decay < last);
            last = decay;
        }
        assert_true(last < 1.001);
    }
}

/* A build that takes longer needs more decay to pay. */
static void test_quality(void **state)
{
    (void)state;
    for (double rays = 0.1; rays < 200; rays *= 10)
        for (int i = 1; i < 3; i++)
            assert_true(decay_to_rebuild(qualities[i], rays) > decay_to_rebuild(qualities[i - 1], rays));
}

/* Without a number of rays, or with one that makes no sense, there is one ray for each primitive. */
static void test_unknown(void **state)
{
    (void)state;
    const double one = decay_to_rebuild(QUALITY_BALANCED, 1);
    assert_true(one > 1.5 && one < 2.2);
    assert_true(decay_to_rebuild(QUALITY_BALANCED, 0) == one);
    assert_true(decay_to_rebuild(QUALITY_BALANCED, -3) == one);
    assert_true(decay_to_rebuild(QUALITY_BALANCED, NAN) == one);
    assert_true(decay_to_rebuild(QUALITY_UNSPECIFIED, 1) == one);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rays),
        cmocka_unit_test(test_quality),
        cmocka_unit_test(test_unknown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
