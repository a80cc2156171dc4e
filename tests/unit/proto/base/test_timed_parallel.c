/* SPDX-License-Identifier: Apache-2.0 */
/* test_timed_parallel.c - tests that work is cancelled at the first task after its moment, and not before. */
#include "tests/support/unit.h"

#include "proto/base/clock.h"
#include "proto/base/timed_parallel.h"

struct work {
    _Atomic uint64_t moment;
    atomic_bool cancel;
    size_t done;
};

/* The third task lets the time run out. */
static void do_task(void *context, size_t index)
{
    struct work *work = context;
    assert_int_equal(index, work->done);
    if (++work->done == 3)
        atomic_store(&work->moment, clock_ns());
}

static void tasks_end_at_the_moment(void **state)
{
    (void)state;
    static const uint64_t moments[] = {TIMED_PARALLEL_NEVER, 0};
    for (size_t i = 0; i < 2; i++) {
        struct work work = {.moment = moments[i]};
        struct timed_parallel timed;
        timed_parallel_init(&timed, &parallel_serial, &work.moment, &work.cancel);
        assert_int_equal(timed.parallel.threads, 1);
        assert_false(parallel_for_until(&timed.parallel, &work.cancel, 10, do_task, &work));
        assert_int_equal(work.done, i == 0 ? 3 : 0);
    }
}

static void tasks_run_without_a_moment(void **state)
{
    (void)state;
    struct work work = {.moment = TIMED_PARALLEL_NEVER, .done = 3};
    struct timed_parallel timed;
    timed_parallel_init(&timed, &parallel_serial, &work.moment, &work.cancel);
    parallel_for(&timed.parallel, 0, NULL, NULL);
    work.done = 0;
    assert_true(parallel_for_until(&timed.parallel, &work.cancel, 2, do_task, &work));
    assert_int_equal(work.done, 2);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(tasks_end_at_the_moment),
        cmocka_unit_test(tasks_run_without_a_moment),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
