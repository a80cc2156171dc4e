/* SPDX-License-Identifier: Apache-2.0 */
/* test_pool_calls.c - tests that for_each runs every task once, on all threads, also when calls nest. */
#include "tests/support/daemon/pool_steps.h"

#include <sched.h>

static const unsigned thread_counts[] = {1, 2, 3, 8};

enum { THREAD_COUNTS = sizeof thread_counts / sizeof thread_counts[0], MOST_TASKS = 300 };

/* A job, and the state that its tasks share. */
struct act {
    struct step step; /* has to be the first field: the job's step is cast to the act */
    const struct parallel *parallel;
    unsigned threads;
    atomic_uint runs[MOST_TASKS];
    size_t plain[MOST_TASKS]; /* not atomic: the caller must see it when for_each returns */
    pthread_barrier_t barrier;
    atomic_bool first_done;
    pthread_t foreign_thread, waiter;
    atomic_bool helper_began, beside_began;
    atomic_bool failed;
};

/* Runs `body` as the only job of a new pool. */
static void perform(struct act *act, unsigned threads, void (*body)(struct step *step, const struct parallel *parallel))
{
    struct loop loop;
    loop_init(&loop, threads);
    struct pool_flow *flow = loop_flow(&loop);
    memset(act, 0, sizeof *act);
    step_init(&act->step, &loop, flow, 1000);
    act->step.body = body;
    act->threads = threads;
    pthread_barrier_init(&act->barrier, NULL, threads);
    step_submit(&act->step);
    step_await(&loop, &act->step);
    assert_false(act->failed);
    pthread_barrier_destroy(&act->barrier);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void count_run(void *context, size_t index)
{
    struct act *act = context;
    atomic_fetch_add(&act->runs[index], 1);
    act->plain[index] = index + 1;
}

static void call_and_check(struct step *step, const struct parallel *parallel)
{
    struct act *act = (struct act *)step;
    static const size_t counts[] = {0, 1, 2, 3, 7, 64, MOST_TASKS};
    act->failed |= parallel->threads != act->threads;
    for (unsigned round = 0; round < 50; round++)
        for (size_t c = 0; c < sizeof counts / sizeof counts[0]; c++) {
            memset(act->plain, 0, sizeof act->plain);
            memset(act->runs, 0, sizeof act->runs);
            parallel_for(parallel, counts[c], count_run, act);
            for (size_t i = 0; i < MOST_TASKS; i++)
                act->failed |= act->runs[i] != (i < counts[c]) || act->plain[i] != (i < counts[c] ? i + 1 : 0);
        }
}

static void every_task_runs_once(void **state)
{
    (void)state;
    static struct act act;
    for (int t = 0; t < THREAD_COUNTS; t++)
        perform(&act, thread_counts[t], call_and_check);
}

static void meet(void *context, size_t index)
{
    (void)index;
    pthread_barrier_wait(&((struct act *)context)->barrier);
}

/* The tasks wait for each other, so the job ends only if as many tasks run at the same time as there are threads. */
static void let_all_meet(struct step *step, const struct parallel *parallel)
{
    for (int round = 0; round < 50; round++)
        parallel_for(parallel, (size_t)2 * parallel->threads, meet, step);
}

static void all_threads_work(void **state)
{
    (void)state;
    static struct act act;
    for (int t = 0; t < THREAD_COUNTS; t++)
        perform(&act, thread_counts[t], let_all_meet);
}

struct nest {
    const struct parallel *parallel;
    unsigned depth;
    atomic_uint *leaves;
};

static void descend(void *context, size_t index)
{
    (void)index;
    const struct nest *nest = context;
    if (nest->depth == 0) {
        atomic_fetch_add(nest->leaves, 1);
        return;
    }
    struct nest below = *nest;
    below.depth--;
    parallel_for(nest->parallel, 4, descend, &below);
}

static void call_nested(struct step *step, const struct parallel *parallel)
{
    atomic_uint leaves = 0;
    struct nest nest = {parallel, 5, &leaves};
    parallel_for(parallel, 4, descend, &nest);
    ((struct act *)step)->failed = leaves != 4096;
}

static void calls_nest(void **state)
{
    (void)state;
    static struct act act;
    for (int t = 0; t < THREAD_COUNTS; t++)
        perform(&act, thread_counts[t], call_nested);
}

/* Task 1 makes a call for both threads after task 0 has ended: the thread that ran task 0 must come back and help. */
static void call_when_the_other_is_done(void *context, size_t index)
{
    struct act *act = context;
    if (index == 0) {
        act->first_done = true;
        return;
    }
    while (!act->first_done)
        sched_yield();
    if (act->step.count % 3 == 0)
        steps_sleep_ms(1);
    parallel_for(act->parallel, 2, meet, act);
}

static void call_late(struct step *step, const struct parallel *parallel)
{
    struct act *act = (struct act *)step;
    act->parallel = parallel;
    for (step->count = 0; step->count < 150; step->count++) {
        act->first_done = false;
        parallel_for(parallel, 2, call_when_the_other_is_done, act);
    }
}

static void a_waiting_caller_helps(void **state)
{
    (void)state;
    static struct act act;
    perform(&act, 2, call_late);
}

/*
 * Task 0 makes an inner call with two tasks: the one on its own thread ends early, and the one on a second thread waits
 * for all tasks that task 1 makes on a third. Meanwhile the first thread waits, and must not take tasks of the third:
 * one of those could keep it from going on.
 */
enum { BESIDE = 40 };

static void work_beside(void *context, size_t index)
{
    struct act *act = context;
    (void)index;
    act->beside_began = true;
    steps_burn(50000);
    act->failed |= pthread_equal(pthread_self(), act->waiter);
    atomic_fetch_add(&act->runs[0], 1);
}

static void wait_inside(void *context, size_t index)
{
    struct act *act = context;
    (void)index;
    bool own = pthread_equal(pthread_self(), act->waiter);
    act->helper_began = act->helper_began || !own;
    while (own ? !act->helper_began || !act->beside_began : act->runs[0] < BESIDE)
        sched_yield();
}

static void wait_or_work(void *context, size_t index)
{
    struct act *act = context;
    if (index == 0) {
        act->waiter = pthread_self();
        parallel_for(act->parallel, 2, wait_inside, act);
        return;
    }
    while (!act->helper_began)
        sched_yield();
    parallel_for(act->parallel, BESIDE, work_beside, act);
}

static void call_side_by_side(struct step *step, const struct parallel *parallel)
{
    struct act *act = (struct act *)step;
    act->parallel = parallel;
    for (int round = 0; round < 10; round++) {
        act->runs[0] = 0;
        act->helper_began = act->beside_began = false;
        parallel_for(parallel, 2, wait_or_work, act);
    }
}

static void a_waiting_caller_helps_nobody_else(void **state)
{
    (void)state;
    static struct act act;
    perform(&act, 3, call_side_by_side);
}

/*
 * The runner's task returns at once, and the helper's sleeps. The time in which the runner waits for it must not count.
 */
static void sleep_unless_runner(void *context, size_t index)
{
    (void)index;
    struct act *act = context;
    pthread_barrier_wait(&act->barrier);
    if (!pthread_equal(pthread_self(), act->step.runner))
        steps_sleep_ms(100);
}

static void wait_for_a_helper(struct step *step, const struct parallel *parallel)
{
    parallel_for(parallel, 2, sleep_unless_runner, step);
}

static void waiting_is_not_counted(void **state)
{
    (void)state;
    struct loop loop;
    static struct act act;
    loop_init(&loop, 2);
    struct pool_flow *flow = loop_flow(&loop);
    memset(&act, 0, sizeof act);
    step_init(&act.step, &loop, flow, 1000);
    act.step.body = wait_for_a_helper;
    pthread_barrier_init(&act.barrier, NULL, 2);
    step_submit(&act.step);
    step_await(&loop, &act.step);
    uint64_t wall = act.step.job.ended_ns - act.step.job.started_ns, busy = pool_load(loop.pool).busy_ns;
    assert_true(wall >= 100000000);
    assert_in_range(busy, 100000000, 2 * wall - 30000000);
    pthread_barrier_destroy(&act.barrier);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

/* A thread that does not belong to the pool runs all tasks of its call itself. */
static void count_own_run(void *context, size_t index)
{
    struct act *act = context;
    steps_burn(20000);
    act->runs[index] += pthread_equal(pthread_self(), act->foreign_thread) != 0;
}

static void *call_from_outside(void *context)
{
    struct act *act = context;
    act->foreign_thread = pthread_self();
    parallel_for(act->parallel, MOST_TASKS, count_own_run, act);
    return NULL;
}

static void call_on_own_thread(struct step *step, const struct parallel *parallel)
{
    struct act *act = (struct act *)step;
    pthread_t thread;
    act->parallel = parallel;
    act->failed = pthread_create(&thread, NULL, call_from_outside, act) != 0;
    if (act->failed)
        return;
    pthread_join(thread, NULL);
    for (size_t i = 0; i < MOST_TASKS; i++)
        act->failed |= act->runs[i] != 1;
}

static void foreign_threads_may_call(void **state)
{
    (void)state;
    static struct act act;
    perform(&act, 3, call_on_own_thread);
}

/* Jobs of two flows make nested calls at the same time. */
static void several_jobs_call_at_once(void **state)
{
    (void)state;
    enum { ACTS = 24 };
    static struct act acts[ACTS];
    struct loop loop;
    loop_init(&loop, 3);
    struct pool_flow *flows[2] = {loop_flow(&loop), loop_flow(&loop)};
    for (int i = 0; i < ACTS; i++) {
        step_init(&acts[i].step, &loop, flows[i % 2], 1000);
        acts[i].step.body = call_nested;
        acts[i].step.job.priority = i % 3;
        step_submit(&acts[i].step);
    }
    for (int i = 0; i < ACTS; i++) {
        step_await(&loop, &acts[i].step);
        assert_false(acts[i].failed);
    }
    pool_flow_end(loop.pool, flows[0]);
    pool_flow_end(loop.pool, flows[1]);
    loop_finish(&loop);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_task_runs_once),
        cmocka_unit_test(all_threads_work),
        cmocka_unit_test(calls_nest),
        cmocka_unit_test(a_waiting_caller_helps),
        cmocka_unit_test(a_waiting_caller_helps_nobody_else),
        cmocka_unit_test(waiting_is_not_counted),
        cmocka_unit_test(foreign_threads_may_call),
        cmocka_unit_test(several_jobs_call_at_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
