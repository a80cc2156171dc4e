/* SPDX-License-Identifier: Apache-2.0 */
/* test_workers.c - tests that the pool runs every task once, on all threads, also in nested and concurrent calls. */
#include "tests/support/unit.h"

#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>

#include "builder/workers.h"

static struct workers *make(unsigned threads)
{
    struct workers *workers = NULL;
    struct bvhd_error error;
    assert_int_equal(workers_create(threads, &workers, &error), BVHD_OK);
    return workers;
}

static const unsigned thread_counts[] = {1, 2, 3, 8};

enum { THREAD_COUNTS = sizeof thread_counts / sizeof thread_counts[0] };

enum { MOST_TASKS = 1000 };

struct tally {
    atomic_uint runs[MOST_TASKS];
    size_t plain[MOST_TASKS]; /* not atomic: the caller must see it when for_each returns */
};

static void count_run(void *context, size_t index)
{
    struct tally *tally = context;
    atomic_fetch_add(&tally->runs[index], 1);
    tally->plain[index] = index + 1;
}

static void check_tally(const struct parallel *parallel, size_t count)
{
    struct tally tally = {0};
    parallel_for(parallel, count, count_run, &tally);
    for (size_t i = 0; i < MOST_TASKS; i++) {
        assert_int_equal(tally.runs[i], i < count);
        assert_int_equal(tally.plain[i], i < count ? i + 1 : 0);
    }
}

static void every_task_runs_once(void **state)
{
    (void)state;
    static const size_t counts[] = {0, 1, 2, 3, 7, 64, MOST_TASKS};
    for (int t = 0; t < THREAD_COUNTS; t++) {
        struct workers *workers = make(thread_counts[t]);
        for (int round = 0; round < 50; round++)
            for (size_t c = 0; c < sizeof counts / sizeof counts[0]; c++)
                check_tally(workers_parallel(workers), counts[c]);
        workers_destroy(workers);
    }
}

static void meet(void *context, size_t index)
{
    (void)index;
    pthread_barrier_wait(context);
}

/* The tasks wait for each other at a barrier, so the test ends only when as many run at once as there are threads. */
static void all_threads_work(void **state)
{
    (void)state;
    for (int t = 0; t < THREAD_COUNTS; t++) {
        struct workers *workers = make(thread_counts[t]);
        const struct parallel *parallel = workers_parallel(workers);
        assert_int_equal(parallel->threads, thread_counts[t]);
        for (int round = 0; round < 50; round++) {
            pthread_barrier_t barrier;
            pthread_barrier_init(&barrier, NULL, thread_counts[t]);
            parallel_for(parallel, (size_t)2 * thread_counts[t], meet, &barrier);
            pthread_barrier_destroy(&barrier);
        }
        workers_destroy(workers);
    }
}

struct nest {
    const struct parallel *parallel;
    unsigned depth, width;
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
    parallel_for(nest->parallel, nest->width, descend, &below);
}

static void calls_nest(void **state)
{
    (void)state;
    for (int t = 0; t < THREAD_COUNTS; t++) {
        struct workers *workers = make(thread_counts[t]);
        atomic_uint leaves = 0;
        struct nest nest = {workers_parallel(workers), 6, 4, &leaves};
        parallel_for(nest.parallel, 4, descend, &nest);
        assert_int_equal(leaves, 4 * 4096);
        workers_destroy(workers);
    }
}

/* Two threads hold at most eight calls open, so that the calls below the eighth level run on their callers alone. */
static void calls_nest_deeper_than_there_is_room(void **state)
{
    (void)state;
    struct workers *workers = make(2);
    atomic_uint leaves = 0;
    struct nest nest = {workers_parallel(workers), 12, 2, &leaves};
    parallel_for(nest.parallel, 2, descend, &nest);
    assert_int_equal(leaves, 8192);
    check_tally(nest.parallel, MOST_TASKS);
    workers_destroy(workers);
}

struct late_call {
    const struct parallel *parallel;
    pthread_barrier_t barrier;
    atomic_bool first_done;
};

/*
 * Task 1 makes a call for both threads after task 0 has ended: the caller, whose own tasks are done, must come and
 * help.
 */
static void call_when_the_other_is_done(void *context, size_t index)
{
    struct late_call *late = context;
    if (index == 0) {
        late->first_done = true;
        return;
    }
    while (!late->first_done)
        sched_yield();
    parallel_for(late->parallel, 2, meet, &late->barrier);
}

static void a_waiting_caller_helps(void **state)
{
    (void)state;
    struct workers *workers = make(2);
    for (int round = 0; round < 300; round++) {
        struct late_call late = {.parallel = workers_parallel(workers)};
        pthread_barrier_init(&late.barrier, NULL, 2);
        parallel_for(late.parallel, 2, call_when_the_other_is_done, &late);
        pthread_barrier_destroy(&late.barrier);
    }
    workers_destroy(workers);
}

struct two_pools {
    const struct parallel *first, *second;
    atomic_uint leaves;
};

static void count_leaf(void *context, size_t index)
{
    (void)index;
    atomic_fetch_add(&((struct two_pools *)context)->leaves, 1);
}

static void call_first(void *context, size_t index)
{
    (void)index;
    parallel_for(((struct two_pools *)context)->first, 5, count_leaf, context);
}

static void call_second(void *context, size_t index)
{
    (void)index;
    parallel_for(((struct two_pools *)context)->second, 5, call_first, context);
}

static void pools_call_each_other(void **state)
{
    (void)state;
    struct workers *first = make(3), *second = make(2);
    struct two_pools pools = {.first = workers_parallel(first), .second = workers_parallel(second)};
    for (int round = 0; round < 50; round++)
        parallel_for(pools.first, 5, call_second, &pools);
    assert_int_equal(pools.leaves, 50 * 125);
    workers_destroy(first);
    workers_destroy(second);
}

static void *call_many_times(void *context)
{
    for (int round = 0; round < 100; round++) {
        atomic_uint leaves = 0;
        struct nest nest = {context, 2, 5, &leaves};
        parallel_for(context, 5, descend, &nest);
        if (leaves != 125)
            return NULL;
    }
    return context;
}

static void several_threads_call_at_once(void **state)
{
    (void)state;
    struct workers *workers = make(3);
    struct parallel interface = *workers_parallel(workers);
    assert_int_equal(interface.threads, 3);
    pthread_t threads[4];
    void *parallel = (void *)(uintptr_t)workers_parallel(workers);
    for (int i = 0; i < 4; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, call_many_times, parallel), 0);
    for (int i = 0; i < 4; i++) {
        void *good = NULL;
        pthread_join(threads[i], &good);
        assert_non_null(good);
    }
    workers_destroy(workers);
}

static void zero_means_each_processor(void **state)
{
    (void)state;
    cpu_set_t before, one;
    assert_int_equal(sched_getaffinity(0, sizeof before, &before), 0);
    struct workers *workers = make(0);
    assert_int_equal(workers_parallel(workers)->threads, CPU_COUNT(&before));
    workers_destroy(workers);

    CPU_ZERO(&one);
    for (int cpu = 0; CPU_COUNT(&one) == 0; cpu++)
        if (CPU_ISSET(cpu, &before))
            CPU_SET(cpu, &one);
    assert_int_equal(sched_setaffinity(0, sizeof one, &one), 0);
    workers = make(0);
    assert_int_equal(workers_parallel(workers)->threads, 1);
    workers_destroy(workers);
    assert_int_equal(sched_setaffinity(0, sizeof before, &before), 0);
}

static void too_many_are_refused(void **state)
{
    (void)state;
    struct workers *workers = NULL;
    struct bvhd_error error;
    assert_int_equal(workers_create(WORKERS_MAX_THREADS + 1, &workers, &error), BVHD_TOO_LARGE);
    assert_int_equal(workers_create((unsigned)-1, &workers, &error), BVHD_TOO_LARGE);
    assert_string_equal(error.where, "threads");
    assert_null(workers);
}

struct signal_view {
    pthread_barrier_t barrier;
    pthread_t caller;
    atomic_int blocked;
};

static void look_at_mask(void *context, size_t index)
{
    (void)index;
    struct signal_view *view = context;
    sigset_t mask;
    pthread_sigmask(SIG_SETMASK, NULL, &mask);
    if (!pthread_equal(pthread_self(), view->caller))
        atomic_fetch_add(&view->blocked, sigismember(&mask, SIGINT) && sigismember(&mask, SIGTERM));
    pthread_barrier_wait(&view->barrier);
}

static void signals_go_to_the_program(void **state)
{
    (void)state;
    struct workers *workers = make(3);
    struct signal_view view = {.caller = pthread_self()};
    pthread_barrier_init(&view.barrier, NULL, 3);
    parallel_for(workers_parallel(workers), 3, look_at_mask, &view);
    pthread_barrier_destroy(&view.barrier);
    assert_int_equal(view.blocked, 2);
    sigset_t mask;
    pthread_sigmask(SIG_SETMASK, NULL, &mask);
    assert_false(sigismember(&mask, SIGINT));
    workers_destroy(workers);
}

static void they_come_and_go(void **state)
{
    (void)state;
    for (unsigned round = 0; round < 100; round++) {
        struct workers *workers = make(1 + round % 5);
        if (round % 2)
            check_tally(workers_parallel(workers), 10);
        workers_destroy(workers);
    }
    workers_destroy(NULL);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_task_runs_once),
        cmocka_unit_test(all_threads_work),
        cmocka_unit_test(calls_nest),
        cmocka_unit_test(calls_nest_deeper_than_there_is_room),
        cmocka_unit_test(a_waiting_caller_helps),
        cmocka_unit_test(pools_call_each_other),
        cmocka_unit_test(several_threads_call_at_once),
        cmocka_unit_test(zero_means_each_processor),
        cmocka_unit_test(too_many_are_refused),
        cmocka_unit_test(signals_go_to_the_program),
        cmocka_unit_test(they_come_and_go),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
