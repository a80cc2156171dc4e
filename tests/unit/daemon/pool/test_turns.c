/* SPDX-License-Identifier: Apache-2.0 */
/* test_turns.c - tests that threads get the turns and the weight that they ask for, and never more weight. */
#include "tests/support/unit.h"

#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "daemon/pool/turns.h"

struct attributes {
    uint32_t size, policy;
    uint64_t flags;
    int32_t nice;
    uint32_t priority;
    uint64_t runtime, deadline, period;
};

static struct attributes now(void)
{
    struct attributes attributes = {.size = sizeof attributes};
    assert_int_equal(syscall(SYS_sched_getattr, 0, &attributes, sizeof attributes, 0), 0);
    return attributes;
}

static void test_turns_change_and_weight_stays(void **state)
{
    struct turns turns;
    int most = now().nice + TURNS_LESS_WEIGHT;
    (void)state;
    turns_begin(&turns, TURNS_SHORT_NS, TURNS_LESS_WEIGHT);
    if (!turns.are_known)
        skip(); /* the system refuses */
    assert_true(turns.are_short);
    assert_int_equal(now().nice, most < 19 ? most : 19);
    uint64_t brief = now().runtime; /* 0 before Linux 6.12 */
    turns_set(&turns, false);
    assert_true(brief == 0 || now().runtime > brief);
    turns_set(&turns, true);
    assert_int_equal(now().runtime, brief);
    assert_int_equal(now().nice, most < 19 ? most : 19);
}

/*
 * A policy that an administrator has chosen is kept. This test comes last, because a thread cannot leave that policy.
 */
static void test_other_policies_are_left(void **state)
{
    struct turns turns;
    struct sched_param none = {0};
    (void)state;
    assert_int_equal(sched_setscheduler(0, SCHED_IDLE, &none), 0);
    turns_begin(&turns, TURNS_SHORT_NS, TURNS_LESS_WEIGHT);
    assert_false(turns.are_known);
    turns_set(&turns, false);
    assert_int_equal(now().policy, SCHED_IDLE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_turns_change_and_weight_stays),
        cmocka_unit_test(test_other_policies_are_left),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
