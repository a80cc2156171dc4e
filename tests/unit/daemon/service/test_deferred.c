/* SPDX-License-Identifier: Apache-2.0 */
/* test_deferred.c - tests that deferred calls run once, in order, and not after they were cancelled. */
#include "tests/support/unit.h"

#include "daemon/service/deferred.h"

enum { CALLS = 4 };

struct numbered {
    struct deferred_call call;
    int number;
};

static struct deferred_calls calls;
static struct numbered items[CALLS];
static int log_of_runs[2 * CALLS], runs;
static struct numbered *to_add; /* by the call that runs next */

static void run(struct deferred_call *call)
{
    log_of_runs[runs++] = ((struct numbered *)(void *)call)->number;
    if (to_add)
        deferred_add(&calls, &to_add->call);
    to_add = NULL;
}

static int set_up(void **state)
{
    (void)state;
    calls = (struct deferred_calls){0};
    runs = 0;
    for (int i = 0; i < CALLS; i++) {
        items[i] = (struct numbered){.call.run = run, .number = i};
        deferred_add(&calls, &items[i].call);
    }
    return 0;
}

static void test_calls_run_once_and_in_order(void **state)
{
    (void)state;
    deferred_run(&calls);
    assert_int_equal(runs, CALLS);
    for (int i = 0; i < CALLS; i++)
        assert_int_equal(log_of_runs[i], i);
    deferred_run(&calls);
    assert_int_equal(runs, CALLS);
}

static void test_cancelled_calls_do_not_run(void **state)
{
    (void)state;
    for (int left = 0; left < CALLS; left++) {
        set_up(NULL);
        for (int i = 0; i < CALLS; i++)
            if (i != left)
                deferred_cancel(&calls, &items[i].call);
        deferred_run(&calls);
        assert_int_equal(runs, 1);
        assert_int_equal(log_of_runs[0], left);
    }
}

static void test_a_call_may_add_calls(void **state)
{
    (void)state;
    to_add = &items[0];
    deferred_run(&calls);
    assert_int_equal(runs, CALLS + 1);
    assert_int_equal(log_of_runs[CALLS], 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(test_calls_run_once_and_in_order, set_up),
        cmocka_unit_test_setup(test_cancelled_calls_do_not_run, set_up),
        cmocka_unit_test_setup(test_a_call_may_add_calls, set_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
