/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/pool/pool.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/pool/pool_internal.h"
#include "proto/base/processor.h"

/*
 * The lock is held for less than a microsecond, so a thread that finds it taken spins for a moment. If threads slept at
 * once, they would queue up asleep.
 */
static void init_lock(pthread_mutex_t *lock)
{
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_settype(&attributes, PTHREAD_MUTEX_ADAPTIVE_NP);
    pthread_mutex_init(lock, &attributes);
    pthread_mutexattr_destroy(&attributes);
}

static struct pool *allocate(unsigned threads)
{
    struct pool *pool = calloc(1, sizeof *pool + (threads + (size_t)POOL_SPARE_THREADS) * sizeof pool->all_threads[0]);
    if (!pool)
        return NULL;
    init_lock(&pool->lock);
    pool->threads = threads;
    pool->ended_end = &pool->ended;
    return pool;
}

enum bvhd_status pool_create(unsigned threads, void (*wake)(void *context), void *wake_context, struct pool **ret_pool,
                             struct bvhd_error *error)
{
    if (threads > POOL_MAX_THREADS)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "threads", "%u threads are more than %d", threads,
                              POOL_MAX_THREADS);
    unsigned processors = processor_count();
    if (threads == 0)
        threads = processors < POOL_MAX_THREADS ? processors : POOL_MAX_THREADS;
    struct pool *pool = allocate(threads);
    if (!pool)
        return bvhd_error_no_memory(error, "threads", "no memory for %u threads", threads);
    pool->wake = wake;
    pool->wake_context = wake_context;
    int failure = pool_threads_start(pool);
    if (failure) {
        pool_destroy(pool);
        return bvhd_error_set(error, BVHD_IO, "threads", "cannot start %u threads: %s", threads, strerror(failure));
    }
    *ret_pool = pool;
    return BVHD_OK;
}

void pool_destroy(struct pool *pool)
{
    if (!pool)
        return;
    pool_threads_stop(pool);
    assert(!pool->root.flows.first && !pool->ended);
    pthread_mutex_destroy(&pool->lock);
    free(pool);
}

unsigned pool_threads(const struct pool *pool)
{
    return pool->threads;
}

struct pool_flow *pool_flow_create(struct pool *pool, struct pool_flow *within)
{
    struct pool_flow *flow = calloc(1, sizeof *flow);
    if (!flow)
        return NULL;
    flow->parent = within ? within : &pool->root;
    flow->parent->jobs++;
    return flow;
}

static void free_if_unused(struct pool_flow *flow)
{
    while (flow->ended && flow->jobs == 0) {
        struct pool_flow *parent = flow->parent;
        free(flow);
        parent->jobs--;
        flow = parent;
    }
}

void pool_flow_end(struct pool *pool, struct pool_flow *flow)
{
    (void)pool;
    if (!flow)
        return;
    flow->ended = true;
    free_if_unused(flow);
}

struct pool_flow_load pool_flow_load(struct pool *pool, const struct pool_flow *flow)
{
    pool_lock(pool);
    struct pool_flow_load load = {(uint32_t)flow->busy.threads, pool_time_at(&flow->busy, clock_ns())};
    pool_unlock(pool);
    return load;
}

void pool_submit(struct pool *pool, struct pool_job *job)
{
    job->flow->jobs++;
    pool_lock(pool);
    uint64_t now = clock_ns();
    job->state = POOL_JOB_QUEUED;
    job->ran = false;
    job->submitted_ns = now;
    job->started_ns = job->ended_ns = 0;
    job->order = pool->orders++;
    pool_flows_add_job(pool, job, now);
    pool_threads_call(pool, 1, now);
    pool_unlock(pool);
}

void pool_append_ended(struct pool *pool, struct pool_job *job)
{
    pool->wake_is_due |= !pool->ended;
    job->state = POOL_JOB_ENDED;
    job->next = NULL;
    *pool->ended_end = job;
    pool->ended_end = &job->next;
}

void pool_cancel(struct pool *pool, struct pool_job *job)
{
    atomic_store_explicit(&job->cancel, true, memory_order_relaxed);
    pool_lock(pool);
    if (job->state == POOL_JOB_QUEUED) {
        pool_flows_take_job(pool, job);
        pool_flows_close_job(pool, job, clock_ns());
        pool_append_ended(pool, job);
    }
    pool_unlock(pool);
}

static void change_flow(struct pool *pool, struct pool_job *job, struct pool_flow *flow, int priority, bool always)
{
    struct pool_flow *old = job->flow;
    pool_lock(pool);
    uint64_t now = clock_ns();
    if ((job->state == POOL_JOB_QUEUED || job->state == POOL_JOB_RUNNING) &&
        (always || pool_flows_is_earlier(flow, priority, job, now)))
        pool_flows_move_job(pool, job, flow, priority, now);
    pool_unlock(pool);
    if (job->flow == old)
        return;
    job->flow->jobs++;
    old->jobs--;
    free_if_unused(old);
}

void pool_favour(struct pool *pool, struct pool_job *job, struct pool_flow *flow, int priority)
{
    change_flow(pool, job, flow, priority, false);
}

void pool_move(struct pool *pool, struct pool_job *job, struct pool_flow *flow, int priority)
{
    change_flow(pool, job, flow, priority, true);
}

/* Takes the jobs that ended first, POOL_COLLECT_MOST at most. If any are left, the loop is woken again. */
static struct pool_job *take_ended(struct pool *pool, bool *ret_more)
{
    pool_lock(pool);
    struct pool_job *jobs = pool->ended, **end = &pool->ended;
    for (int i = 0; i < POOL_COLLECT_MOST && *end; i++)
        end = &(*end)->next;
    pool->ended = *end;
    *end = NULL;
    if (!pool->ended)
        pool->ended_end = &pool->ended;
    *ret_more = pool->ended != NULL;
    pool->wake_is_due |= *ret_more;
    pool_unlock(pool);
    return jobs;
}

bool pool_collect(struct pool *pool)
{
    bool more;
    for (struct pool_job *job = take_ended(pool, &more), *next; job; job = next) {
        struct pool_flow *flow = job->flow;
        next = job->next;
        job->done(job);
        flow->jobs--;
        free_if_unused(flow);
    }
    return more;
}

struct pool_load pool_load(struct pool *pool)
{
    pool_lock(pool);
    uint64_t now = clock_ns();
    struct pool_load load = {
        .queued = pool->queued,
        .running = pool->running,
        .busy_ns = pool_time_at(&pool->root.busy, now),
        .jobs_done = pool->jobs_done,
        .active_ns = pool_time_at(&pool->open, now),
    };
    pool_unlock(pool);
    return load;
}
