/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/daemon/pool_steps.h"

#include <time.h>

uint64_t steps_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

void steps_sleep_ms(long milliseconds)
{
    nanosleep(&(struct timespec){.tv_sec = milliseconds / 1000, .tv_nsec = milliseconds % 1000 * 1000000}, NULL);
}

void steps_burn(uint64_t nanoseconds)
{
    for (uint64_t begin = steps_now_ns(); steps_now_ns() - begin < nanoseconds;)
        continue;
}

static void wake(void *context)
{
    struct loop *loop = context;
    pthread_mutex_lock(&loop->lock);
    loop->wakes++;
    pthread_cond_signal(&loop->woken);
    pthread_mutex_unlock(&loop->lock);
}

void loop_init(struct loop *loop, unsigned threads)
{
    struct bvhd_error error;
    *loop =
        (struct loop){.lock = PTHREAD_MUTEX_INITIALIZER, .woken = PTHREAD_COND_INITIALIZER, .thread = pthread_self()};
    assert_int_equal(pool_create(threads, wake, loop, &loop->pool, &error), BVHD_OK);
}

void loop_finish(struct loop *loop)
{
    pool_destroy(loop->pool);
    pthread_cond_destroy(&loop->woken);
    pthread_mutex_destroy(&loop->lock);
}

unsigned loop_wakes(struct loop *loop)
{
    pthread_mutex_lock(&loop->lock);
    unsigned wakes = loop->wakes;
    pthread_mutex_unlock(&loop->lock);
    return wakes;
}

void loop_once(struct loop *loop)
{
    struct timespec limit;
    clock_gettime(CLOCK_REALTIME, &limit);
    limit.tv_sec += 60;
    int failure = 0;
    pthread_mutex_lock(&loop->lock);
    while (!failure && loop->seen == loop->wakes)
        failure = pthread_cond_timedwait(&loop->woken, &loop->lock, &limit);
    loop->seen = loop->wakes;
    pthread_mutex_unlock(&loop->lock);
    assert_int_equal(failure, 0);
    pool_collect(loop->pool);
}

void step_await(struct loop *loop, const struct step *step)
{
    while (!step->done)
        loop_once(loop);
}

static void run_step(struct pool_job *job, const struct parallel *parallel)
{
    struct step *step = (struct step *)job;
    step->runner = pthread_self();
    if (step->log)
        step->log->steps[atomic_fetch_add(&step->log->count, 1)] = step;
    sem_post(&step->started);
    if (step->burn_ns)
        steps_burn(step->burn_ns);
    if (step->body)
        step->body(step, parallel);
    step->cancelled_inside = job->cancel;
}

void step_submit(struct step *step)
{
    pool_submit(step->loop->pool, &step->job);
}

void step_done(struct pool_job *job)
{
    struct step *step = (struct step *)job;
    assert_true(pthread_equal(pthread_self(), step->loop->thread));
    step->done++;
    if (step->to_submit)
        step_submit(step->to_submit);
    if (step->to_cancel)
        pool_cancel(step->loop->pool, &step->to_cancel->job);
    if (step->to_end)
        pool_flow_end(step->loop->pool, step->to_end);
}

void step_init(struct step *step, struct loop *loop, struct pool_flow *flow, uint64_t size)
{
    *step = (struct step){.job = {.run = run_step, .done = step_done, .flow = flow, .size = size}, .loop = loop};
    sem_init(&step->started, 0, 0);
    sem_init(&step->may_end, 0, 0);
}

struct pool_flow *loop_flow(struct loop *loop)
{
    struct pool_flow *flow = pool_flow_create(loop->pool, NULL);
    assert_non_null(flow);
    return flow;
}

void steps_wait(sem_t *semaphore)
{
    while (sem_wait(semaphore) != 0)
        continue;
}

bool step_has_started(struct step *step)
{
    int value = 0;
    sem_getvalue(&step->started, &value);
    return value > 0;
}

static void hold(struct step *step, const struct parallel *parallel)
{
    (void)parallel;
    steps_wait(&step->may_end);
}

void step_hold_thread(struct step *step, struct loop *loop, struct pool_flow *flow, uint64_t size)
{
    step_init(step, loop, flow, size);
    step->body = hold;
    step_submit(step);
    steps_wait(&step->started);
}

void step_let_go(struct step *step)
{
    sem_post(&step->may_end);
}

static void burn_task(void *context, size_t index)
{
    struct step *step = context;
    (void)index;
    atomic_fetch_add(&step->tasks, 1);
    if (!pthread_equal(pthread_self(), step->runner))
        step->helped = true;
    if (!step->job.cancel)
        steps_burn(500000);
}

void step_many_tasks(struct step *step, const struct parallel *parallel)
{
    parallel_for(parallel, step->count, burn_task, step);
}
