/* SPDX-License-Identifier: Apache-2.0 */
/* test_pool_spare.c - tests when spare threads start small jobs beside large ones, and when they do not. */
#include "tests/support/daemon/pool_steps.h"

#include <sched.h>

static void a_small_job_starts_beside_a_large_one(void **state)
{
    (void)state;
    for (unsigned threads = 1; threads <= 3; threads++) {
        struct loop loop;
        struct step large[3], small, smaller;
        loop_init(&loop, threads);
        struct pool_flow *flow = loop_flow(&loop), *other = loop_flow(&loop);
        for (unsigned i = 0; i < threads; i++)
            step_hold_thread(&large[i], &loop, flow, 102400 + i);
        step_hold_thread(&small, &loop, other, 12800);
        step_hold_thread(&smaller, &loop, flow, 100);
        assert_int_equal(pool_load(loop.pool).running, threads + 2);
        step_let_go(&smaller);
        step_let_go(&small);
        step_await(&loop, &small);
        step_await(&loop, &smaller);
        for (unsigned i = 0; i < threads; i++) {
            step_let_go(&large[i]);
            step_await(&loop, &large[i]);
        }
        pool_flow_end(loop.pool, flow);
        pool_flow_end(loop.pool, other);
        loop_finish(&loop);
    }
}

/* Gives a step that must not start some time, in which it could start by mistake. */
static void check_waits(struct step *step)
{
    steps_sleep_ms(10);
    assert_false(step_has_started(step));
}

static void others_wait(void **state)
{
    (void)state;
    struct loop loop;
    struct step large, similar, small, same, smaller, smallest;
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop), *other = loop_flow(&loop);
    step_hold_thread(&large, &loop, flow, 819200);
    step_init(&similar, &loop, other, 131072);
    step_submit(&similar);
    check_waits(&similar);
    step_hold_thread(&small, &loop, other, 64000);
    step_init(&same, &loop, flow, 64000);
    step_submit(&same);
    check_waits(&same);
    step_hold_thread(&smaller, &loop, other, 8000);
    step_init(&smallest, &loop, other, 1);
    step_submit(&smallest);
    check_waits(&smallest);
    assert_int_equal(pool_load(loop.pool).queued, 3);

    /* When `smaller` ends, its thread is free for `smallest`; when `small` ends too, a thread is free for `same`. */
    step_let_go(&smaller);
    step_await(&loop, &smallest);
    assert_false(step_has_started(&same));
    step_let_go(&small);
    step_await(&loop, &same);
    assert_false(step_has_started(&similar));
    step_let_go(&large);
    step_await(&loop, &large);
    step_await(&loop, &similar);
    pool_flow_end(loop.pool, flow);
    pool_flow_end(loop.pool, other);
    loop_finish(&loop);
}

static void a_job_that_ends_soon_is_waited_for(void **state)
{
    (void)state;
    struct loop loop;
    struct step running, small;
    for (uint64_t size = POOL_SPARE_LEAST - 1; size <= POOL_SPARE_LEAST; size++) {
        loop_init(&loop, 1);
        struct pool_flow *flow = loop_flow(&loop), *other = loop_flow(&loop);
        step_hold_thread(&running, &loop, flow, size);
        step_init(&small, &loop, other, 1);
        step_submit(&small);
        if (size < POOL_SPARE_LEAST)
            check_waits(&small);
        else
            step_await(&loop, &small);
        step_let_go(&running);
        step_await(&loop, &running);
        step_await(&loop, &small);
        pool_flow_end(loop.pool, flow);
        pool_flow_end(loop.pool, other);
        loop_finish(&loop);
    }
}

static void a_small_job_does_not_wait_behind_a_large_one(void **state)
{
    (void)state;
    struct loop loop;
    struct step running, queued, small;
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_hold_thread(&running, &loop, flow, 1000000);
    step_init(&queued, &loop, flow, 1000000);
    queued.job.priority = 5;
    step_submit(&queued);
    step_init(&small, &loop, flow, 0);
    step_submit(&small);
    step_await(&loop, &small);
    assert_false(step_has_started(&queued));
    step_let_go(&running);
    step_await(&loop, &running);
    step_await(&loop, &queued);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void hold(struct step *step, const struct parallel *parallel)
{
    (void)parallel;
    steps_wait(&step->may_end);
}

/*
 * The worker takes the large job after the first one, before the small ones. Only then may spare threads start the
 * small ones.
 */
static void a_spare_thread_comes_when_a_large_one_starts(void **state)
{
    (void)state;
    struct loop loop;
    struct step first, large, small[3], similar;
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_hold_thread(&first, &loop, flow, 10);
    step_init(&large, &loop, flow, 10000);
    large.body = hold;
    large.job.priority = 1;
    step_submit(&large);
    for (int i = 0; i < 3; i++) {
        step_init(&small[i], &loop, flow, 10);
        step_submit(&small[i]);
    }
    step_init(&similar, &loop, flow, 20000);
    step_submit(&similar);
    check_waits(&small[0]);
    step_let_go(&first);
    for (int i = 0; i < 3; i++)
        step_await(&loop, &small[i]);
    assert_int_equal(large.done, 0);
    assert_false(step_has_started(&similar));
    step_let_go(&large);
    step_await(&loop, &large);
    step_await(&loop, &similar);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void sleep_for_count(struct step *step, const struct parallel *parallel)
{
    (void)parallel;
    steps_sleep_ms((long)step->count);
}

/*
 * Two jobs wait for one of their size to end. The flow that has had less time is served first, whichever of the two was
 * created first.
 */
static void a_spare_thread_goes_to_the_least_served(void **state)
{
    (void)state;
    for (int fresh = 0; fresh < 2; fresh++) {
        struct loop loop;
        struct log log = {0};
        struct step large, served, between, small[2];
        loop_init(&loop, 1);
        struct pool_flow *flow = loop_flow(&loop), *flows[2] = {loop_flow(&loop), loop_flow(&loop)};
        step_hold_thread(&large, &loop, flow, 10000);
        step_init(&served, &loop, flows[1 - fresh], 10);
        served.body = sleep_for_count;
        served.count = 10;
        step_submit(&served);
        step_await(&loop, &served);
        step_hold_thread(&between, &loop, flow, 10);
        for (int i = 0; i < 2; i++) {
            step_init(&small[i], &loop, flows[i], 10);
            small[i].log = &log;
            step_submit(&small[i]);
        }
        step_let_go(&between);
        for (int i = 0; i < 2; i++)
            step_await(&loop, &small[i]);
        assert_ptr_equal(log.steps[0], &small[fresh]);
        step_let_go(&large);
        step_await(&loop, &large);
        pool_flow_end(loop.pool, flow);
        pool_flow_end(loop.pool, flows[0]);
        pool_flow_end(loop.pool, flows[1]);
        loop_finish(&loop);
    }
}

static void small_jobs_flow_beside_tasks(void **state)
{
    (void)state;
    struct loop loop;
    struct step large, small;
    for (unsigned threads = 1; threads <= 3; threads++) {
        loop_init(&loop, threads);
        struct pool_flow *flow = loop_flow(&loop), *other = loop_flow(&loop);
        step_init(&large, &loop, flow, 1000000);
        large.body = step_many_tasks;
        large.count = 100000;
        step_submit(&large);
        steps_wait(&large.started);
        for (int i = 0; i < 30; i++) {
            step_init(&small, &loop, i % 2 ? flow : other, 10);
            small.burn_ns = 100000;
            step_submit(&small);
            step_await(&loop, &small);
        }
        assert_int_equal(large.done, 0);
        pool_cancel(loop.pool, &large.job);
        step_await(&loop, &large);
        assert_int_equal(large.tasks, large.count);
        pool_flow_end(loop.pool, flow);
        pool_flow_end(loop.pool, other);
        loop_finish(&loop);
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_small_job_starts_beside_a_large_one),
        cmocka_unit_test(others_wait),
        cmocka_unit_test(a_job_that_ends_soon_is_waited_for),
        cmocka_unit_test(a_small_job_does_not_wait_behind_a_large_one),
        cmocka_unit_test(a_spare_thread_comes_when_a_large_one_starts),
        cmocka_unit_test(a_spare_thread_goes_to_the_least_served),
        cmocka_unit_test(small_jobs_flow_beside_tasks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
