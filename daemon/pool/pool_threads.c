/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/pool/pool_internal.h"

#include <signal.h>

#include "proto/base/processor.h"

static _Thread_local struct pool_thread *self_thread;

struct pool_thread *pool_threads_self(void)
{
    return self_thread;
}

void pool_threads_wake(struct pool *pool, struct pool_thread *thread)
{
    thread->next = pool->to_wake;
    pool->to_wake = thread;
}

void pool_unlock(struct pool *pool)
{
    struct pool_thread *thread = pool->to_wake;
    bool wake_is_due = pool->wake_is_due;
    pool->to_wake = NULL;
    pool->wake_is_due = false;
    pthread_mutex_unlock(&pool->lock);
    while (thread) {
        /* `next` is read first: once the thread is awake, it can be put on another list. */
        struct pool_thread *next = thread->next;
        sem_post(&thread->wake);
        thread = next;
    }
    if (wake_is_due)
        pool->wake(pool->wake_context);
}

void pool_threads_sleep(struct pool *pool, struct pool_thread *self)
{
    pool_unlock(pool);
    while (sem_wait(&self->wake) != 0)
        continue;
    pool_lock(pool);
}

void pool_threads_resume(struct pool_run *run, uint64_t now)
{
    run->threads++;
    pool_flow_add_threads(run->job->flow, 1, now);
}

void pool_threads_pause(struct pool_run *run, uint64_t now)
{
    run->threads--;
    pool_flow_remove_threads(run->job->flow, 1, now);
}

/* Makes all spinning threads check for work. */
static void signal_spinning(struct pool *pool)
{
    atomic_fetch_add_explicit(&pool->posted, 1, memory_order_relaxed);
}

/* Calls one more thread to look for work. Returns false when every thread is busy or has been called. */
static bool call_one(struct pool *pool)
{
    if (pool->called_spinning < pool->spinning) {
        pool->called_spinning++;
        signal_spinning(pool);
    } else if (pool->idle) {
        struct pool_thread *thread = pool->idle;
        pool->idle = thread->next;
        pool_threads_wake(pool, thread);
    } else {
        return false;
    }
    pool->coming++;
    return true;
}

/* Calls a spare thread if all workers are busy and there is a job that a spare thread may start. */
static void call_spare(struct pool *pool, uint64_t now)
{
    unsigned busy = pool->active + pool->coming;
    if (pool->queued > 0 && busy >= pool->threads && busy < pool->threads + POOL_SPARE_THREADS &&
        pool_flows_spare_job(pool, now))
        call_one(pool);
}

void pool_threads_call(struct pool *pool, size_t count, uint64_t now)
{
    while (count > 0 && pool->active + pool->coming < pool->threads && call_one(pool))
        count--;
    if (count > 0)
        call_spare(pool, now);
}

static void begin(struct pool *pool, struct pool_run *run, uint64_t now)
{
    pool->active++;
    pool_threads_resume(run, now);
    call_spare(pool, now);
}

static void end(struct pool *pool, struct pool_run *run, uint64_t now)
{
    pool->active--;
    pool_threads_pause(run, now);
}

static void link_run(struct pool *pool, struct pool_run *run)
{
    list_prepend(&pool->runs, &run->link);
    pool->running++;
}

static void unlink_run(struct pool *pool, struct pool_run *run)
{
    list_remove(&pool->runs, &run->link);
    pool->running--;
}

static void mark_running(struct pool *pool, struct pool_job *job, uint64_t now)
{
    pool_flows_take_job(pool, job);
    job->state = POOL_JOB_RUNNING;
    job->ran = true;
    job->started_ns = now;
}

static void run_job(struct pool *pool, struct pool_job *job, uint64_t now)
{
    struct pool_run run = {.parallel = {pool->threads, pool_calls_for_each}, .pool = pool, .job = job};
    mark_running(pool, job, now);
    link_run(pool, &run);
    begin(pool, &run, now);
    pool_unlock(pool);

    turns_set(&self_thread->turns, job->size < POOL_SPARE_LEAST);
    job->run(job, &run.parallel);
    turns_set(&self_thread->turns, true);

    pool_lock(pool);
    job->ended_ns = clock_ns();
    end(pool, &run, job->ended_ns);
    unlink_run(pool, &run);
    pool->jobs_done++;
    pool_flows_close_job(pool, job, job->ended_ns);
    pool_append_ended(pool, job);
}

/* The run outlives the help: its job cannot go on before the lock is open. */
static void help_call(struct pool *pool, struct pool_call *call, uint64_t now)
{
    struct pool_run *run = call->run;
    begin(pool, run, now);
    pool_calls_help(pool, call, now);
    end(pool, run, clock_ns());
}

static struct pool_work find_work(struct pool *pool, uint64_t now)
{
    if (pool->active < pool->threads)
        return pool_flows_next(pool, now);
    return (struct pool_work){NULL, pool_flows_spare_job(pool, now)};
}

/* Spins for a while, then sleeps, until the thread is called to look for work or the pool stops. */
static void wait_for_work(struct pool *pool, struct pool_thread *self)
{
    unsigned seen = atomic_load_explicit(&pool->posted, memory_order_relaxed);
    pool->spinning++;
    pool_unlock(pool);
    for (int i = 0; i < POOL_SPIN_ROUNDS && atomic_load_explicit(&pool->posted, memory_order_relaxed) == seen; i++)
        processor_relax();
    pool_lock(pool);
    pool->spinning--;
    if (pool->called_spinning > 0) {
        pool->called_spinning--;
        pool->coming--;
    } else if (!pool->stop) {
        self->next = pool->idle;
        pool->idle = self;
        pool_threads_sleep(pool, self);
        pool->coming--;
    }
}

static void *work_until_stopped(void *argument)
{
    struct pool_thread *self = argument;
    struct pool *pool = self->pool;
    self_thread = self;
    turns_begin(&self->turns, TURNS_SHORT_NS, TURNS_LESS_WEIGHT);
    pool_lock(pool);
    while (!pool->stop) {
        uint64_t now = clock_ns();
        struct pool_work work = find_work(pool, now);
        if (work.call)
            help_call(pool, work.call, now);
        else if (work.job)
            run_job(pool, work.job, now);
        else
            wait_for_work(pool, self);
    }
    pool_unlock(pool);
    return NULL;
}

static int start_thread(struct pool *pool, struct pool_thread *thread)
{
    thread->pool = pool;
    sem_init(&thread->wake, 0, 0);
    int failure = pthread_create(&thread->id, NULL, work_until_stopped, thread);
    if (failure)
        sem_destroy(&thread->wake);
    return failure;
}

/* All signals are blocked on the pool's threads, so that the loop thread takes them. */
int pool_threads_start(struct pool *pool)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int failure = 0;
    while (!failure && pool->started < pool->threads + POOL_SPARE_THREADS) {
        failure = start_thread(pool, &pool->all_threads[pool->started]);
        pool->started += failure == 0;
    }
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return failure;
}

void pool_threads_stop(struct pool *pool)
{
    pool_lock(pool);
    pool->stop = true;
    signal_spinning(pool);
    for (struct pool_thread *thread = pool->idle, *next; thread; thread = next) {
        next = thread->next;
        pool_threads_wake(pool, thread);
        pool->coming++;
    }
    pool->idle = NULL;
    pool_unlock(pool);
    for (unsigned i = 0; i < pool->started; i++)
        pthread_join(pool->all_threads[i].id, NULL);
    for (unsigned i = 0; i < pool->started; i++)
        sem_destroy(&pool->all_threads[i].wake);
}
