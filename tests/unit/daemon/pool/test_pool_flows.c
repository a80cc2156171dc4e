/* SPDX-License-Identifier: Apache-2.0 */
/* test_pool_flows.c - tests the order in which threads take work: by priority, by age, and by time among flows. */
#include "tests/support/daemon/pool_steps.h"

#include <sched.h>

static void priority_then_age_within_a_flow(void **state)
{
    (void)state;
    static const int priorities[] = {0, -3, 7, 0, 7, 1, -3, 0};
    static const int order[] = {2, 4, 5, 0, 3, 7, 1, 6};
    struct log log = {0};
    struct loop loop;
    struct step holder, steps[8];
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop);
    step_hold_thread(&holder, &loop, flow, 10);
    for (int i = 0; i < 8; i++) {
        step_init(&steps[i], &loop, flow, 100 + (uint64_t)(i * 37 % 8) * 80);
        steps[i].job.priority = priorities[i];
        steps[i].log = &log;
        step_submit(&steps[i]);
    }
    step_let_go(&holder);
    for (int i = 0; i < 8; i++)
        step_await(&loop, &steps[i]);
    step_await(&loop, &holder);
    for (int i = 0; i < 8; i++)
        assert_ptr_equal(log.steps[i], &steps[order[i]]);
    pool_flow_end(loop.pool, flow);
    loop_finish(&loop);
}

/* What a flow has had is its jobs' own time, also when its place among others was moved up to theirs. */
static void the_load_of_a_flow_is_its_own(void **state)
{
    (void)state;
    struct loop loop;
    struct step holder, step;
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop), *late = loop_flow(&loop);
    assert_int_equal(pool_flow_load(loop.pool, flow).threads, 0);
    assert_int_equal(pool_flow_load(loop.pool, flow).busy_ns, 0);
    step_hold_thread(&holder, &loop, flow, 10);
    assert_int_equal(pool_flow_load(loop.pool, flow).threads, 1);
    step_let_go(&holder);
    step_await(&loop, &holder);
    step_init(&step, &loop, late, 10);
    step_submit(&step);
    step_await(&loop, &step);
    const struct step *steps[] = {&holder, &step};
    const struct pool_flow *flows[] = {flow, late};
    for (int i = 0; i < 2; i++) {
        struct pool_flow_load load = pool_flow_load(loop.pool, flows[i]);
        assert_int_equal(load.threads, 0);
        assert_in_range(load.busy_ns, 1, steps[i]->job.ended_ns - steps[i]->job.submitted_ns);
    }
    pool_flow_end(loop.pool, flow);
    pool_flow_end(loop.pool, late);
    loop_finish(&loop);
}

enum { EACH = 12, RIVALS = 3 };

struct rivalry {
    struct loop loop;
    struct pool_flow *flows[RIVALS];
    struct step steps[RIVALS][EACH];
    struct log log;
};

static void rivalry_init(struct rivalry *rivalry)
{
    loop_init(&rivalry->loop, 1);
    for (int r = 0; r < RIVALS; r++)
        rivalry->flows[r] = loop_flow(&rivalry->loop);
    rivalry->log.count = 0;
}

static void rivalry_finish(struct rivalry *rivalry)
{
    for (int r = 0; r < RIVALS; r++)
        pool_flow_end(rivalry->loop.pool, rivalry->flows[r]);
    loop_finish(&rivalry->loop);
}

/* Queues EACH jobs of the rival's flow. */
static void enter_race(struct rivalry *rivalry, int rival, uint64_t burn_ns)
{
    for (int i = 0; i < EACH; i++) {
        struct step *step = &rivalry->steps[rival][i];
        step_init(step, &rivalry->loop, rivalry->flows[rival], 10);
        step->burn_ns = burn_ns;
        step->log = &rivalry->log;
        step_submit(step);
    }
}

static int rival_of(const struct rivalry *rivalry, const struct step *step)
{
    return (int)((step - &rivalry->steps[0][0]) / EACH);
}

/*
 * Checks that each job that started was of the flow that had had the least time among those with queued jobs. The times
 * that the flows had at the start of the race may differ by `slack`.
 */
static void check_race(struct rivalry *rivalry, int rivals, uint64_t slack)
{
    uint64_t time[RIVALS] = {0};
    int left[RIVALS] = {EACH, EACH, EACH};
    assert_int_equal(rivalry->log.count, rivals * EACH);
    for (int i = 0; i < rivals * EACH; i++) {
        const struct step *step = rivalry->log.steps[i];
        int rival = rival_of(rivalry, step);
        for (int other = 0; other < rivals; other++)
            assert_true(left[other] == 0 || time[rival] <= time[other] + slack);
        time[rival] += step->job.ended_ns - step->job.started_ns;
        left[rival]--;
    }
}

static void await_race(struct rivalry *rivalry, int rivals)
{
    for (int r = 0; r < rivals; r++)
        for (int i = 0; i < EACH; i++)
            step_await(&rivalry->loop, &rivalry->steps[r][i]);
}

/*
 * Each job of the second flow is submitted by done() of the one before. After a job that took too long, because the
 * machine was busy, the order is not checked, since the pool forgives such a time.
 */
static void a_flow_that_submits_one_by_one_gets_only_its_share(void **state)
{
    (void)state;
    struct rivalry rivalry;
    struct step holder;
    rivalry_init(&rivalry);
    step_hold_thread(&holder, &rivalry.loop, rivalry.flows[2], 10);
    enter_race(&rivalry, 0, 500000);
    for (int i = 0; i < EACH; i++) {
        step_init(&rivalry.steps[1][i], &rivalry.loop, rivalry.flows[1], 10);
        rivalry.steps[1][i].burn_ns = 1000000;
        rivalry.steps[1][i].log = &rivalry.log;
        rivalry.steps[1][i].to_submit = i + 1 < EACH ? &rivalry.steps[1][i + 1] : NULL;
    }
    step_submit(&rivalry.steps[1][0]);
    step_let_go(&holder);
    await_race(&rivalry, 2);
    step_await(&rivalry.loop, &holder);
    uint64_t time[2] = {0, 0};
    int left = EACH;
    bool stalled = false;
    for (int i = 0; i < 2 * EACH; i++) {
        const struct step *step = rivalry.log.steps[i];
        int rival = rival_of(&rivalry, step);
        assert_true(rival == 0 || left == 0 || time[1] <= time[0] || stalled);
        left -= rival == 0;
        stalled |= step->job.ended_ns - step->job.started_ns > 50000000;
        time[rival] += step->job.ended_ns - step->job.started_ns;
    }
    rivalry_finish(&rivalry);
}

static void sleep_for_count(struct step *step, const struct parallel *parallel)
{
    (void)parallel;
    steps_sleep_ms((long)step->count);
}

/* A flow that has had 300 ms while there was no other does not have to wait for as long when another one comes. */
static void time_had_alone_is_forgiven(void **state)
{
    (void)state;
    enum { RIVAL = 25 };
    struct loop loop;
    struct log log = {0};
    struct step alone, holder, again, rivals[RIVAL];
    loop_init(&loop, 1);
    struct pool_flow *flow = loop_flow(&loop), *other = loop_flow(&loop), *third = loop_flow(&loop);
    step_init(&alone, &loop, flow, 10);
    alone.body = sleep_for_count;
    alone.count = 300;
    step_submit(&alone);
    step_await(&loop, &alone);
    step_hold_thread(&holder, &loop, third, 10);
    for (int i = 0; i < RIVAL; i++) {
        step_init(&rivals[i], &loop, other, 10);
        rivals[i].body = sleep_for_count;
        rivals[i].count = 10;
        rivals[i].log = &log;
        step_submit(&rivals[i]);
    }
    step_init(&again, &loop, flow, 10);
    again.log = &log;
    step_submit(&again);
    step_let_go(&holder);
    step_await(&loop, &again);
    assert_in_range(log.count, 2, RIVAL);
    for (int i = 0; i < RIVAL; i++)
        step_await(&loop, &rivals[i]);
    step_await(&loop, &holder);
    pool_flow_end(loop.pool, flow);
    pool_flow_end(loop.pool, other);
    pool_flow_end(loop.pool, third);
    loop_finish(&loop);
}

static void the_least_served_flow_is_next(void **state)
{
    (void)state;
    struct rivalry rivalry;
    struct step holder;
    rivalry_init(&rivalry);
    struct pool_flow *flow = loop_flow(&rivalry.loop);
    step_hold_thread(&holder, &rivalry.loop, flow, 10);
    for (int r = 0; r < RIVALS; r++)
        enter_race(&rivalry, r, 300000 * (uint64_t)(1 + r * r));
    step_let_go(&holder);
    await_race(&rivalry, RIVALS);
    step_await(&rivalry.loop, &holder);
    check_race(&rivalry, RIVALS, 0);
    pool_flow_end(rivalry.loop.pool, flow);
    rivalry_finish(&rivalry);
}

static void a_newcomer_starts_level(void **state)
{
    (void)state;
    struct rivalry rivalry;
    struct step holder, last;
    rivalry_init(&rivalry);
    /*
     * The second flow has the machine to itself for a while. After that it is ahead of the first by its last job at
     * most.
     */
    enter_race(&rivalry, 1, 2000000);
    for (int i = 0; i < EACH; i++)
        step_await(&rivalry.loop, &rivalry.steps[1][i]);
    step_init(&last, &rivalry.loop, rivalry.flows[1], 10);
    step_submit(&last);
    step_await(&rivalry.loop, &last);
    step_hold_thread(&holder, &rivalry.loop, rivalry.flows[2], 10);
    rivalry.log.count = 0;
    enter_race(&rivalry, 0, 500000);
    enter_race(&rivalry, 1, 500000);
    step_let_go(&holder);
    await_race(&rivalry, 2);
    step_await(&rivalry.loop, &holder);
    check_race(&rivalry, 2, last.job.ended_ns - last.job.started_ns);
    rivalry_finish(&rivalry);
}

struct meeting {
    struct loop loop;
    struct pool_flow *flow, *other;
    struct step large, newcomer;
};

/* A large job keeps all threads busy. The newcomer is as large, so that no spare thread starts it. */
static void meeting_init(struct meeting *meeting, unsigned threads)
{
    loop_init(&meeting->loop, threads);
    meeting->flow = loop_flow(&meeting->loop);
    meeting->other = loop_flow(&meeting->loop);
    step_init(&meeting->large, &meeting->loop, meeting->flow, 100000);
    meeting->large.body = step_many_tasks;
    meeting->large.count = 100000;
    step_init(&meeting->newcomer, &meeting->loop, meeting->other, 100000);
}

static void start_large(struct meeting *meeting)
{
    step_submit(&meeting->large);
    while (!meeting->large.helped)
        sched_yield();
}

static void meeting_finish(struct meeting *meeting)
{
    step_await(&meeting->loop, &meeting->large);
    step_await(&meeting->loop, &meeting->newcomer);
    pool_flow_end(meeting->loop.pool, meeting->flow);
    pool_flow_end(meeting->loop.pool, meeting->other);
    loop_finish(&meeting->loop);
}

static void a_helper_leaves_for_another_flow(void **state)
{
    (void)state;
    struct meeting meeting;
    meeting_init(&meeting, 2);
    start_large(&meeting);
    step_submit(&meeting.newcomer);
    step_await(&meeting.loop, &meeting.newcomer);
    assert_int_equal(meeting.large.done, 0);
    assert_true(meeting.large.tasks < meeting.large.count);
    pool_cancel(meeting.loop.pool, &meeting.large.job);
    meeting_finish(&meeting);
}

static void a_helper_leaves_for_a_higher_priority(void **state)
{
    (void)state;
    struct meeting meeting;
    meeting_init(&meeting, 2);
    meeting.newcomer.job.flow = meeting.flow;
    meeting.newcomer.job.priority = 1;
    start_large(&meeting);
    step_submit(&meeting.newcomer);
    step_await(&meeting.loop, &meeting.newcomer);
    assert_true(meeting.large.tasks < meeting.large.count);
    pool_cancel(meeting.loop.pool, &meeting.large.job);
    meeting_finish(&meeting);
}

static void note_tasks_of_other(struct step *step, const struct parallel *parallel)
{
    (void)parallel;
    step->count = step->other->tasks;
}

/* Returns how many threads are at work, as counted by the pool. */
static double threads_at_work(struct loop *loop)
{
    uint64_t begin = steps_now_ns(), busy = pool_load(loop->pool).busy_ns;
    steps_sleep_ms(5);
    busy = pool_load(loop->pool).busy_ns - busy;
    return (double)busy / (double)(steps_now_ns() - begin);
}

static void a_helper_makes_room_for_a_spare_thread(void **state)
{
    (void)state;
    struct meeting meeting;
    struct step small;
    meeting_init(&meeting, 2);
    start_large(&meeting);
    step_hold_thread(&small, &meeting.loop, meeting.other, 1);
    for (int tries = 0; threads_at_work(&meeting.loop) > 2.1; tries++)
        assert_true(tries < 1000);
    step_let_go(&small);
    step_await(&meeting.loop, &small);
    pool_cancel(meeting.loop.pool, &meeting.large.job);
    step_submit(&meeting.newcomer);
    meeting_finish(&meeting);
}

static void open_tasks_come_before_a_queued_job(void **state)
{
    (void)state;
    struct meeting meeting;
    meeting_init(&meeting, 2);
    meeting.large.count = 60;
    meeting.newcomer.job.flow = meeting.flow;
    meeting.newcomer.body = note_tasks_of_other;
    meeting.newcomer.other = &meeting.large;
    start_large(&meeting);
    step_submit(&meeting.newcomer);
    step_await(&meeting.loop, &meeting.newcomer);
    /* The thread that took the last task has perhaps not counted it yet. */
    assert_true(meeting.newcomer.count >= 59);
    meeting_finish(&meeting);
}

/* The test uses the time that the pool has counted, so that a busy machine makes no difference. */
static void both_progress_in_proportion(void **state)
{
    (void)state;
    enum { FLOOD = 240 };
    static struct step flood[FLOOD];
    struct meeting meeting;
    meeting_init(&meeting, 3);
    meeting.large.job.size = 10;
    start_large(&meeting);
    uint64_t busy = pool_load(meeting.loop.pool).busy_ns, small = 0;
    for (int i = 0; i < FLOOD; i++) {
        step_init(&flood[i], &meeting.loop, meeting.other, 10);
        flood[i].burn_ns = 500000;
        step_submit(&flood[i]);
    }
    for (int i = 0; i < FLOOD; i++) {
        step_await(&meeting.loop, &flood[i]);
        small += flood[i].job.ended_ns - flood[i].job.started_ns;
    }
    busy = pool_load(meeting.loop.pool).busy_ns - busy;
    assert_in_range(small * 100 / busy, 30, 70);
    step_submit(&meeting.newcomer);
    pool_cancel(meeting.loop.pool, &meeting.large.job);
    meeting_finish(&meeting);
}

/*
 * While the helper works on a call, a step in another flow is submitted every 300 us. The later ones must not keep the
 * earlier ones from starting.
 */
static void newcomers_are_not_put_off_by_more_of_them(void **state)
{
    (void)state;
    enum { MOST = 1500 };
    static struct step steps[MOST];
    struct meeting meeting;
    meeting_init(&meeting, 2);
    start_large(&meeting);
    int count = 0;
    do {
        assert_true(count < MOST);
        step_init(&steps[count], &meeting.loop, meeting.other, 100000);
        step_submit(&steps[count++]);
        steps_burn(300000);
    } while (!step_has_started(&steps[0]));
    for (int i = 0; i < count; i++)
        step_await(&meeting.loop, &steps[i]);
    assert_int_equal(meeting.large.done, 0);
    pool_cancel(meeting.loop.pool, &meeting.large.job);
    step_submit(&meeting.newcomer);
    meeting_finish(&meeting);
}

static void hold_then_many_tasks(struct step *step, const struct parallel *parallel)
{
    steps_wait(&step->may_end);
    step_many_tasks(step, parallel);
}

static void await_help(struct step *step)
{
    for (int tries = 0; !step->helped; tries++) {
        assert_true(tries < 20000);
        steps_sleep_ms(1);
    }
}

/* Waits until `more` further tasks of the step have run. */
static void await_tasks(struct step *step, unsigned more)
{
    for (more += step->tasks; step->tasks < more;)
        steps_sleep_ms(1);
}

/* Two jobs of one flow make their calls in either order; the free thread helps the older job. */
static void the_older_job_is_helped(void **state)
{
    (void)state;
    struct loop loop;
    struct step jobs[2];
    for (int first = 0; first < 2; first++) {
        loop_init(&loop, 3);
        struct pool_flow *flow = loop_flow(&loop);
        for (int i = 0; i < 2; i++) {
            step_init(&jobs[i], &loop, flow, 1000);
            jobs[i].body = hold_then_many_tasks;
            jobs[i].count = 100000;
            step_submit(&jobs[i]);
            steps_wait(&jobs[i].started);
        }
        step_let_go(&jobs[first]);
        await_help(&jobs[first]);
        step_let_go(&jobs[1 - first]);
        await_tasks(&jobs[0], 60);
        await_tasks(&jobs[1], 20);
        await_help(&jobs[0]);
        assert_int_equal(jobs[1].helped, first == 1);
        for (int i = 0; i < 2; i++)
            pool_cancel(loop.pool, &jobs[i].job);
        for (int i = 0; i < 2; i++)
            step_await(&loop, &jobs[i]);
        pool_flow_end(loop.pool, flow);
        loop_finish(&loop);
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(priority_then_age_within_a_flow),
        cmocka_unit_test(the_load_of_a_flow_is_its_own),
        cmocka_unit_test(a_flow_that_submits_one_by_one_gets_only_its_share),
        cmocka_unit_test(time_had_alone_is_forgiven),
        cmocka_unit_test(the_least_served_flow_is_next),
        cmocka_unit_test(a_newcomer_starts_level),
        cmocka_unit_test(a_helper_leaves_for_another_flow),
        cmocka_unit_test(a_helper_leaves_for_a_higher_priority),
        cmocka_unit_test(a_helper_makes_room_for_a_spare_thread),
        cmocka_unit_test(open_tasks_come_before_a_queued_job),
        cmocka_unit_test(both_progress_in_proportion),
        cmocka_unit_test(newcomers_are_not_put_off_by_more_of_them),
        cmocka_unit_test(the_older_job_is_helped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
