/* SPDX-License-Identifier: Apache-2.0 */
/* test_pool_users.c - tests the time of users, whose flows share it, and jobs that several clients want. */
#include "tests/support/unit.h"

#include "daemon/pool/pool_internal.h"
#include "tests/support/daemon/pool_steps.h"

enum { FLOWS = 6, EACH = 4, ALL = FLOWS * EACH };

static struct pool_flow *flow_within(struct loop *loop, struct pool_flow *user)
{
    struct pool_flow *flow = pool_flow_create(loop->pool, user);
    assert_non_null(flow);
    return flow;
}

static void queue(struct step *step, struct loop *loop, struct pool_flow *flow, struct log *log)
{
    step_init(step, loop, flow, 10);
    step->burn_ns = 300000;
    step->log = log;
    step_submit(step);
}

static uint64_t took(const struct step *step)
{
    return step->job.ended_ns - step->job.started_ns;
}

/*
 * One user has many flows, and another one has as many jobs in one flow. Each job that starts is of the user that has
 * had less time; among the flows of the first user it is of the one that has had the least.
 */
static void a_user_with_many_flows_has_the_time_of_one(void **state)
{
    (void)state;
    static struct step many[FLOWS][EACH], single[ALL];
    struct loop loop;
    struct step holder;
    struct log log = {0};
    loop_init(&loop, 1);
    struct pool_flow *users[] = {loop_flow(&loop), loop_flow(&loop)}, *flows[FLOWS],
                     *own = flow_within(&loop, users[1]);
    struct pool_flow *third = loop_flow(&loop);
    step_hold_thread(&holder, &loop, third, 10);
    for (int i = 0; i < FLOWS; i++) {
        flows[i] = flow_within(&loop, users[0]);
        for (int k = 0; k < EACH; k++)
            queue(&many[i][k], &loop, flows[i], &log);
    }
    for (int i = 0; i < ALL; i++)
        queue(&single[i], &loop, own, &log);
    step_let_go(&holder);
    for (int i = 0; i < ALL; i++)
        step_await(&loop, &single[i]);
    for (int i = 0; i < ALL; i++)
        step_await(&loop, &many[i / EACH][i % EACH]);
    step_await(&loop, &holder);
    uint64_t time[2] = {0}, of_flow[FLOWS] = {0};
    int left[2] = {ALL, ALL}, left_of_flow[FLOWS] = {EACH, EACH, EACH, EACH, EACH, EACH};
    for (int i = 0; i < 2 * ALL; i++) {
        const struct step *step = log.steps[i];
        bool is_single = step >= single && step < single + ALL;
        assert_true(left[!is_single] == 0 || time[is_single] <= time[!is_single]);
        time[is_single] += took(step);
        left[is_single]--;
        if (is_single)
            continue;
        size_t flow = (size_t)(step - &many[0][0]) / EACH;
        for (int other = 0; other < FLOWS; other++)
            assert_true(left_of_flow[other] == 0 || of_flow[flow] <= of_flow[other]);
        of_flow[flow] += took(step);
        left_of_flow[flow]--;
    }
    for (int i = 0; i < FLOWS; i++)
        pool_flow_end(loop.pool, flows[i]);
    pool_flow_end(loop.pool, users[1]); /* before the flow within it, which keeps it */
    pool_flow_end(loop.pool, own);
    pool_flow_end(loop.pool, users[0]);
    pool_flow_end(loop.pool, third);
    loop_finish(&loop);
}

struct crowd {
    struct loop loop;
    struct pool_flow *busy, *idle;
    struct step holder, queued[ALL], wanted, again;
    struct log log;
};

/* The busy flow, which has had some time, has many jobs in the queue before the one that is wanted. */
static void crowd_init(struct crowd *crowd)
{
    loop_init(&crowd->loop, 1);
    crowd->log.count = 0;
    crowd->busy = loop_flow(&crowd->loop);
    crowd->idle = loop_flow(&crowd->loop);
    step_hold_thread(&crowd->holder, &crowd->loop, crowd->busy, 10);
    for (int i = 0; i < ALL; i++)
        queue(&crowd->queued[i], &crowd->loop, crowd->busy, &crowd->log);
    queue(&crowd->wanted, &crowd->loop, crowd->busy, &crowd->log);
    steps_sleep_ms(1);
}

static void crowd_finish(struct crowd *crowd)
{
    step_let_go(&crowd->holder);
    step_await(&crowd->loop, &crowd->holder);
    for (int i = 0; i < ALL; i++)
        step_await(&crowd->loop, &crowd->queued[i]);
    step_await(&crowd->loop, &crowd->wanted);
    assert_int_equal(pool_load(crowd->loop.pool).queued, 0);
    pool_flow_end(crowd->loop.pool, crowd->busy);
    pool_flow_end(crowd->loop.pool, crowd->idle);
    loop_finish(&crowd->loop);
}

static void a_queued_job_has_the_earlier_turn_of_two_clients(void **state)
{
    (void)state;
    struct crowd crowd;
    crowd_init(&crowd);
    pool_favour(crowd.loop.pool, &crowd.wanted.job, crowd.idle, 0);
    assert_ptr_equal(crowd.wanted.job.flow, crowd.idle);
    pool_favour(crowd.loop.pool, &crowd.wanted.job, crowd.busy, 5); /* whose turn is later, whatever its priority */
    assert_ptr_equal(crowd.wanted.job.flow, crowd.idle);
    crowd_finish(&crowd);
    assert_ptr_equal(crowd.log.steps[0], &crowd.wanted);
}

static void a_later_turn_changes_nothing_unless_nobody_else_wants_the_job(void **state)
{
    (void)state;
    struct crowd crowd;
    crowd_init(&crowd);
    step_init(&crowd.again, &crowd.loop, crowd.idle, 10);
    step_submit(&crowd.again);
    pool_favour(crowd.loop.pool, &crowd.again.job, crowd.busy, 0);
    assert_ptr_equal(crowd.again.job.flow, crowd.idle);
    pool_move(crowd.loop.pool, &crowd.again.job, crowd.busy, -1);
    assert_ptr_equal(crowd.again.job.flow, crowd.busy);
    pool_favour(crowd.loop.pool, &crowd.wanted.job, crowd.busy, 1); /* the same flow with a higher priority */
    step_let_go(&crowd.holder);
    step_await(&crowd.loop, &crowd.again);
    crowd_finish(&crowd);
    assert_ptr_equal(crowd.log.steps[0], &crowd.wanted);
}

/* A running job, with a helper, goes on in another flow; the one that it leaves can be freed at once. */
static void a_running_job_changes_its_flow(void **state)
{
    (void)state;
    struct loop loop;
    struct step large, small;
    loop_init(&loop, 2);
    struct pool_flow *old = loop_flow(&loop), *user = loop_flow(&loop), *flow = flow_within(&loop, user);
    step_init(&large, &loop, old, 100000);
    large.body = step_many_tasks;
    large.count = 100000;
    step_submit(&large);
    while (!large.helped)
        sched_yield();
    pool_move(loop.pool, &large.job, flow, 1);
    assert_ptr_equal(large.job.flow, flow);
    pool_flow_end(loop.pool, old);
    uint32_t tasks = large.tasks;
    while (large.tasks < tasks + 10)
        sched_yield();
    struct pool_flow *other = loop_flow(&loop); /* a helper still leaves for a flow that has had less time */
    step_init(&small, &loop, other, 100000);
    step_submit(&small);
    step_await(&loop, &small);
    assert_int_equal(large.done, 0);
    pool_cancel(loop.pool, &large.job);
    pool_flow_end(loop.pool, user);
    pool_flow_end(loop.pool, flow);
    pool_flow_end(loop.pool, other);
    step_await(&loop, &large);
    loop_finish(&loop);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_user_with_many_flows_has_the_time_of_one),
        cmocka_unit_test(a_queued_job_has_the_earlier_turn_of_two_clients),
        cmocka_unit_test(a_later_turn_changes_nothing_unless_nobody_else_wants_the_job),
        cmocka_unit_test(a_running_job_changes_its_flow),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
