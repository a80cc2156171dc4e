/* SPDX-License-Identifier: Apache-2.0 */
/*
 * unit.h - cmocka, with the headers that it requires before it. Every unit test starts with this.
 *
 * cmocka reports the failure of a group's tear-down and does not count it. Here it counts as one more failed test.
 */
#ifndef BVHD_UNIT_H
#define BVHD_UNIT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* The tear-down of the group that runs, and whether it has failed. */
static CMFixtureFunction unit_group_teardown;
static int unit_teardown_failed;

static inline int unit_tear_down(void **state)
{
    unit_teardown_failed = 1; /* until it returns, which an assertion would keep it from */
    unit_teardown_failed = unit_group_teardown(state) != 0;
    return unit_teardown_failed ? -1 : 0;
}

static inline int unit_run_group(const char *name, const struct CMUnitTest *tests, size_t count,
                                 CMFixtureFunction setup, CMFixtureFunction teardown)
{
    unit_teardown_failed = 0;
    unit_group_teardown = teardown;
    const int failed = _cmocka_run_group_tests(name, tests, count, setup, teardown ? unit_tear_down : NULL);
    return failed + unit_teardown_failed;
}

#undef cmocka_run_group_tests
#undef cmocka_run_group_tests_name
#define cmocka_run_group_tests_name(name, tests, setup, teardown)                                                      \
    unit_run_group(name, tests, sizeof(tests) / sizeof((tests)[0]), setup, teardown)
#define cmocka_run_group_tests(tests, setup, teardown) cmocka_run_group_tests_name(#tests, tests, setup, teardown)

#endif
