/* SPDX-License-Identifier: Apache-2.0 */
/* test_pool.c - tests that each job runs and is done once, whenever it is cancelled, and that the load is counted. */
#include "tests/support/daemon/pool_steps.h"

#include <sched.h>
#include <signal.h>
#include <time.h>

static void a_job_runs_and_is_done(void **state)
{
    (void)state;
    struct loop loop;
    struct step step;
    loop_init(&loop, 2);
    struct pool_flow *flow = loop_flow(&loop);
    uint64_t begin = steps_now_ns();
    for (unsigned round = 1; round <= 100; round++) {
        step_init(&step, &loop, flow, 10);
        step_submit(&step);
        step_await(&loop, &step);
        assert_int_equal(step.done, 1);
        assert_true(step.job.ran);
        assert_true(begin <= step.job.submitted_ns && step.job.submitted_ns <= step.job.started_ns);
        assert_true(step.job.started_ns <= step.job.ended_ns && step.job.ended_ns <= steps_now_ns());
        assert_int_equal(pool_load(loop.pool).jobs_done, round);
    }
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void one_wake_for_all_ended_jobs(void **state)
{
    (void)state;
    struct loop loop;
    struct step steps[5];
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    for (unsigned round = 1; round <= 20; round++) {
        for (int i = 0; i < 5; i++) {
            step_init(&steps[i], &loop, flow, 10);
            step_submit(&steps[i]);
        }
        while (pool_load(loop.pool).jobs_done < 5 * round)
            sched_yield();
        while (loop_wakes(&loop) < round)
            sched_yield();
        pool_collect(loop.pool);
        for (int i = 0; i < 5; i++)
            assert_int_equal(steps[i].done, 1);
        assert_int_equal(loop_wakes(&loop), round);
    }
    pool_collect(loop.pool);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static unsigned done_order;

static void note_order(struct pool_job *job)
{
    step_done(job);
    ((struct step *)job)->count = done_order++;
}

static void done_in_the_order_of_ending(void **state)
{
    (void)state;
    struct loop loop;
    struct step steps[3];
    loop_init(&loop, 3);
    struct pool_flow *flow = loop_flow(&loop);
    static const int order[] = {2, 0, 1};
    for (int i = 0; i < 3; i++)
        step_hold_thread(&steps[i], &loop, flow, 10);
    for (unsigned i = 0; i < 3; i++) {
        steps[i].job.done = note_order;
        step_let_go(&steps[order[i]]);
        while (pool_load(loop.pool).jobs_done <= i)
            sched_yield();
    }
    done_order = 0;
    for (int i = 0; i < 3; i++)
        step_await(&loop, &steps[i]);
    for (unsigned i = 0; i < 3; i++)
        assert_int_equal(steps[order[i]].count, i);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void done_may_submit(void **state)
{
    (void)state;
    enum { CHAIN = 500 };
    static struct step steps[CHAIN];
    struct loop loop;
    loop_init(&loop, 2);
    struct pool_flow *flow = loop_flow(&loop);
    for (int i = 0; i < CHAIN; i++) {
        step_init(&steps[i], &loop, flow, 10);
        steps[i].to_submit = i + 1 < CHAIN ? &steps[i + 1] : NULL;
    }
    step_submit(&steps[0]);
    step_await(&loop, &steps[CHAIN - 1]);
    assert_int_equal(pool_load(loop.pool).jobs_done, CHAIN);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

/* The same struct is submitted a second time, without being zeroed. */
static void a_done_job_may_come_again(void **state)
{
    (void)state;
    struct loop loop;
    struct step step, holder;
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_init(&step, &loop, flow, 10);
    step_submit(&step);
    step_await(&loop, &step);
    step_hold_thread(&holder, &loop, flow, 10);
    step_submit(&step);
    pool_cancel(loop.pool, &step.job);
    while (step.done < 2)
        loop_once(&loop);
    assert_false(step.job.ran);
    assert_int_equal(step.job.started_ns, 0);
    step_let_go(&holder);
    step_await(&loop, &holder);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void load_counts(void **state)
{
    (void)state;
    struct loop loop;
    struct step holder, waiting[3];
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_hold_thread(&holder, &loop, flow, 10);
    for (int i = 0; i < 3; i++) {
        step_init(&waiting[i], &loop, flow, 10);
        step_submit(&waiting[i]);
    }
    struct pool_load before = pool_load(loop.pool);
    assert_int_equal(before.queued, 3);
    assert_int_equal(before.running, 1);
    assert_int_equal(before.jobs_done, 0);
    steps_sleep_ms(5);
    assert_true(pool_load(loop.pool).busy_ns - before.busy_ns >= 5000000);
    step_let_go(&holder);
    for (int i = 0; i < 3; i++)
        step_await(&loop, &waiting[i]);
    uint64_t busy = holder.job.ended_ns - holder.job.started_ns;
    for (int i = 0; i < 3; i++)
        busy += waiting[i].job.ended_ns - waiting[i].job.started_ns;
    struct pool_load after = pool_load(loop.pool);
    assert_int_equal(after.queued + after.running, 0);
    assert_int_equal(after.jobs_done, 4);
    assert_true(after.busy_ns == busy);
    assert_true(after.active_ns == waiting[2].job.ended_ns - holder.job.submitted_ns);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void pauses(void **state)
{
    (void)state;
    struct loop loop;
    struct step first, soon, late;
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_hold_thread(&first, &loop, flow, 10);
    step_let_go(&first);
    step_await(&loop, &first);
    uint64_t before = pool_load(loop.pool).active_ns;
    assert_true(before == first.job.ended_ns - first.job.submitted_ns);
    step_hold_thread(&soon, &loop, flow, 10);
    step_let_go(&soon);
    step_await(&loop, &soon);
    bool is_short = soon.job.submitted_ns - first.job.ended_ns < POOL_PAUSE_NS;
    uint64_t after = pool_load(loop.pool).active_ns;
    assert_true(after == before + soon.job.ended_ns - (is_short ? first.job.ended_ns : soon.job.submitted_ns));
    steps_sleep_ms(POOL_PAUSE_NS / 1000000 + 1);
    assert_true(pool_load(loop.pool).active_ns == after);
    step_hold_thread(&late, &loop, flow, 10);
    assert_true(pool_load(loop.pool).active_ns - after <= steps_now_ns() - late.job.submitted_ns);
    step_let_go(&late);
    step_await(&loop, &late);
    assert_true(pool_load(loop.pool).active_ns == after + late.job.ended_ns - late.job.submitted_ns);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void cancelled_in_the_queue(void **state)
{
    (void)state;
    enum { QUEUED = 50 };
    struct loop loop;
    struct step holder, steps[QUEUED];
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_hold_thread(&holder, &loop, flow, 10);
    for (int i = 0; i < QUEUED; i++) {
        step_init(&steps[i], &loop, flow, 10);
        steps[i].job.priority = i * 7 % 5;
        step_submit(&steps[i]);
    }
    for (int i = 0; i < QUEUED; i += 2) {
        pool_cancel(loop.pool, &steps[i].job);
        pool_cancel(loop.pool, &steps[i].job);
    }
    assert_int_equal(pool_load(loop.pool).queued, QUEUED / 2);
    pool_collect(loop.pool);
    for (int i = 0; i < QUEUED; i++) {
        assert_int_equal(steps[i].done, i % 2 == 0);
        assert_false(steps[i].job.ran);
        pool_cancel(loop.pool, &steps[i - i % 2].job);
    }
    step_let_go(&holder);
    for (int i = 1; i < QUEUED; i += 2) {
        step_await(&loop, &steps[i]);
        assert_true(steps[i].job.ran && !steps[i].cancelled_inside);
    }
    assert_int_equal(holder.done, 1);
    assert_int_equal(pool_load(loop.pool).jobs_done, QUEUED / 2 + 1);
    for (int i = 0; i < QUEUED; i++)
        assert_int_equal(steps[i].done, 1);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

/* One call of pool_collect finishes a limited number of jobs, so that the loop gets to its other work in between. */
static void collected_in_batches(void **state)
{
    (void)state;
    enum { QUEUED = 2 * POOL_COLLECT_MOST + 10 };
    struct loop loop;
    static struct step holder, steps[QUEUED];
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_hold_thread(&holder, &loop, flow, 10);
    for (int i = 0; i < QUEUED; i++) {
        step_init(&steps[i], &loop, flow, 10);
        step_submit(&steps[i]);
    }
    for (int i = 0; i < QUEUED; i++)
        pool_cancel(loop.pool, &steps[i].job);
    for (int batch = 1; batch <= 3; batch++) {
        unsigned wakes = loop_wakes(&loop);
        assert_int_equal(pool_collect(loop.pool), batch < 3);
        assert_int_equal(loop_wakes(&loop), wakes + (batch < 3));
        for (int i = 0; i < QUEUED; i++)
            assert_int_equal(steps[i].done, i < batch * POOL_COLLECT_MOST);
    }
    assert_false(pool_collect(loop.pool));
    step_let_go(&holder);
    step_await(&loop, &holder);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void a_cancelled_queued_job_wakes_the_loop(void **state)
{
    (void)state;
    struct loop loop;
    struct step holder, step;
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_hold_thread(&holder, &loop, flow, 10);
    step_init(&step, &loop, flow, 10);
    step_submit(&step);
    pool_cancel(loop.pool, &step.job);
    assert_int_equal(loop_wakes(&loop), 1);
    assert_int_equal(step.done, 0);
    step_await(&loop, &step);
    step_let_go(&holder);
    step_await(&loop, &holder);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void wait_for_cancel(struct step *step, const struct parallel *parallel)
{
    (void)parallel;
    while (!step->job.cancel)
        sched_yield();
}

static void cancelled_while_it_runs(void **state)
{
    (void)state;
    struct loop loop;
    struct step step;
    loop_init(&loop, 2);
    struct pool_flow *flow = loop_flow(&loop);
    for (int round = 0; round < 100; round++) {
        step_init(&step, &loop, flow, 10);
        step.body = wait_for_cancel;
        step_submit(&step);
        steps_wait(&step.started);
        pool_cancel(loop.pool, &step.job);
        pool_cancel(loop.pool, &step.job);
        step_await(&loop, &step);
        assert_true(step.job.ran && step.cancelled_inside);
        assert_int_equal(step.done, 1);
        pool_cancel(loop.pool, &step.job);
        pool_collect(loop.pool);
        assert_int_equal(step.done, 1);
    }
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

/*
 * Jobs are cancelled after they have ended and before they are collected: one by the loop, the other by done() of the
 * first.
 */
static void cancelled_too_late(void **state)
{
    (void)state;
    struct loop loop;
    struct step steps[2];
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    for (unsigned round = 1; round <= 50; round++) {
        for (int i = 0; i < 2; i++) {
            step_init(&steps[i], &loop, flow, 10);
            step_submit(&steps[i]);
        }
        steps[0].to_cancel = &steps[1];
        while (pool_load(loop.pool).jobs_done < 2 * round)
            sched_yield();
        pool_cancel(loop.pool, &steps[0].job);
        step_await(&loop, &steps[1]);
        for (int i = 0; i < 2; i++) {
            assert_int_equal(steps[i].done, 1);
            assert_true(steps[i].job.ran && steps[i].job.cancel);
        }
    }
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void done_may_cancel(void **state)
{
    (void)state;
    struct loop loop;
    struct step holder, first, second;
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_hold_thread(&holder, &loop, flow, 10);
    step_init(&first, &loop, flow, 10);
    step_init(&second, &loop, flow, 10);
    first.to_cancel = &second;
    step_submit(&first);
    step_submit(&second);
    pool_cancel(loop.pool, &first.job);
    pool_collect(loop.pool);
    assert_int_equal(first.done, 1);
    assert_int_equal(second.done, 0);
    pool_collect(loop.pool);
    assert_int_equal(second.done, 1);
    assert_false(second.job.ran);
    step_let_go(&holder);
    step_await(&loop, &holder);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void a_flow_ends_before_its_jobs(void **state)
{
    (void)state;
    struct loop loop;
    struct step running, queued, cancelled, ender;
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop), *own = loop_flow(&loop);
    step_hold_thread(&running, &loop, flow, 10);
    step_init(&queued, &loop, flow, 10);
    step_submit(&queued);
    step_init(&cancelled, &loop, flow, 10);
    step_submit(&cancelled);
    pool_flow_end(loop.pool, flow);
    pool_cancel(loop.pool, &cancelled.job);
    pool_collect(loop.pool);
    assert_int_equal(cancelled.done, 1);
    step_let_go(&running);
    step_await(&loop, &queued);
    assert_true(queued.job.ran);

    /* A flow is ended by done() of its last job. */
    step_init(&ender, &loop, own, 10);
    ender.to_end = own;
    step_submit(&ender);
    step_await(&loop, &ender);
    pool_flow_end(loop.pool, loop_flow(&loop));
    pool_flow_end(loop.pool, NULL);
    loop_finish(&loop);
}

static void limits_of_threads(void **state)
{
    (void)state;
    struct pool *pool = NULL;
    struct bvhd_error error;
    struct loop loop;
    assert_int_equal(pool_create(POOL_MAX_THREADS + 1, NULL, NULL, &pool, &error), BVHD_TOO_LARGE);
    assert_string_equal(error.where, "threads");
    assert_int_equal(pool_create((unsigned)-1, NULL, NULL, &pool, &error), BVHD_TOO_LARGE);
    assert_null(pool);
    cpu_set_t set;
    assert_int_equal(sched_getaffinity(0, sizeof set, &set), 0);
    loop_init(&loop, 0);
    assert_int_equal(pool_threads(loop.pool), CPU_COUNT(&set));
    loop_finish(&loop);
    loop_init(&loop, 5);
    assert_int_equal(pool_threads(loop.pool), 5);
    loop_finish(&loop);
}

static void check_signals(struct step *step, const struct parallel *parallel)
{
    (void)parallel;
    sigset_t mask;
    pthread_sigmask(SIG_SETMASK, NULL, &mask);
    step->count = sigismember(&mask, SIGINT) && sigismember(&mask, SIGTERM) && sigismember(&mask, SIGCHLD);
}

static void signals_go_to_the_program(void **state)
{
    (void)state;
    struct loop loop;
    struct step step;
    sigset_t mask;
    loop_init(&loop, 1);
    pthread_sigmask(SIG_SETMASK, NULL, &mask);
    assert_false(sigismember(&mask, SIGTERM));
    struct pool_flow *flow = loop_flow(&loop);
    step_init(&step, &loop, flow, 10);
    step.body = check_signals;
    step_submit(&step);
    step_await(&loop, &step);
    assert_int_equal(step.count, 1);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void idle_threads_sleep(void **state)
{
    (void)state;
    struct loop loop;
    struct step step;
    struct timespec before, after;
    loop_init(&loop, 8);
    struct pool_flow *flow = loop_flow(&loop);
    step_init(&step, &loop, flow, 10);
    step_submit(&step);
    step_await(&loop, &step);
    steps_sleep_ms(5);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &before);
    steps_sleep_ms(100);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &after);
    assert_in_range((after.tv_sec - before.tv_sec) * 1000000000 + after.tv_nsec - before.tv_nsec, 0, 10000000);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

static void pools_come_and_go(void **state)
{
    (void)state;
    for (unsigned round = 0; round < 60; round++) {
        struct loop loop;
        struct step step;
        loop_init(&loop, 1 + round % 4);
        if (round % 3) {
            struct pool_flow *flow = loop_flow(&loop);
            step_init(&step, &loop, flow, 10);
            step_submit(&step);
            while (!step.done)
                pool_collect(loop.pool);
            pool_flow_end(loop.pool, flow);
        }
        loop_finish(&loop);
    }
    pool_destroy(NULL);
}

/* Many jobs submit, cancel and make calls at the same time; each is done once, and runs all its tasks if it runs. */
enum { FLOWS = 5, CROWD = 400 };

static void small_task(void *context, size_t index)
{
    struct step *step = context;
    atomic_fetch_add(&step->tasks, 1);
    steps_burn(index * 1000);
}

static void some_tasks(struct step *step, const struct parallel *parallel)
{
    parallel_for(parallel, step->count, small_task, step);
}

static void fill_crowd(struct step *steps, struct loop *loop, struct pool_flow **flows, unsigned seed)
{
    for (unsigned i = 0; i < CROWD; i++) {
        unsigned random = (i + seed * 977) * 2654435761u >> 8;
        step_init(&steps[i], loop, flows[random % FLOWS], (uint64_t)1 << random / FLOWS % 24);
        steps[i].job.priority = (int)(random >> 4) % 3;
        steps[i].burn_ns = random % 40 * 1000;
        steps[i].body = random % 3 ? some_tasks : NULL;
        steps[i].count = random % 17;
        steps[i].to_cancel = random % 5 == 0 ? &steps[random % CROWD] : NULL;
        steps[i].to_submit = i % 2 == 0 ? &steps[i + 1] : NULL;
    }
}

static void a_crowd(void **state)
{
    (void)state;
    static struct step steps[CROWD];
    for (unsigned round = 0; round < 12; round++) {
        struct loop loop;
        struct pool_flow *flows[FLOWS];
        loop_init(&loop, 1 + round % 4);
        for (int i = 0; i < FLOWS; i++)
            flows[i] = loop_flow(&loop);
        fill_crowd(steps, &loop, flows, round);
        for (int i = 0; i < CROWD; i += 2)
            step_submit(&steps[i]);
        for (int i = 0; i < CROWD; i++)
            step_await(&loop, &steps[i]);
        for (int i = 0; i < CROWD; i++) {
            assert_int_equal(steps[i].done, 1);
            assert_int_equal(steps[i].tasks, steps[i].job.ran && steps[i].body ? steps[i].count : 0);
        }
        for (int i = 0; i < FLOWS; i++)
            pool_flow_end(loop.pool, flows[i]);
        loop_finish(&loop);
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_job_runs_and_is_done),
        cmocka_unit_test(one_wake_for_all_ended_jobs),
        cmocka_unit_test(done_in_the_order_of_ending),
        cmocka_unit_test(done_may_submit),
        cmocka_unit_test(a_done_job_may_come_again),
        cmocka_unit_test(load_counts),
        cmocka_unit_test(pauses),
        cmocka_unit_test(cancelled_in_the_queue),
        cmocka_unit_test(collected_in_batches),
        cmocka_unit_test(a_cancelled_queued_job_wakes_the_loop),
        cmocka_unit_test(cancelled_while_it_runs),
        cmocka_unit_test(cancelled_too_late),
        cmocka_unit_test(done_may_cancel),
        cmocka_unit_test(a_flow_ends_before_its_jobs),
        cmocka_unit_test(limits_of_threads),
        cmocka_unit_test(signals_go_to_the_program),
        cmocka_unit_test(idle_threads_sleep),
        cmocka_unit_test(pools_come_and_go),
        cmocka_unit_test(a_crowd),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
