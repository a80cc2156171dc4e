/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/pool/pool_internal.h"

#include "proto/base/container_of.h"

/*
 * The flow with the least time is served next. A flow cannot claim later the time in which it had no work: when it gets
 * work again, its time is raised to that of the flow that was served last. The time that a flow has had in excess is
 * forgotten except for MAX_DEBT_NS for each worker; otherwise a client that has had the machine to itself for an hour
 * would wait for an hour when another client comes.
 */
enum { MAX_DEBT_NS = 100 * 1000 * 1000 };

/*
 * How far the flow that a helper works for may be ahead of others before the helper changes to another flow. It keeps
 * changes so rare that they cost little.
 */
enum { FAVOUR_NS = 1000 * 1000 };

static struct pool_call *open_call(const struct pool_flow *flow)
{
    for (struct pool_call *call = flow->calls; call; call = call->after)
        if (pool_calls_has_tasks(call))
            return call;
    return NULL;
}

/* Returns the first work of a flow: tasks of its first open call, unless a queued job has a higher priority. */
static struct pool_work work_of(const struct pool_flow *flow)
{
    struct pool_call *call = open_call(flow);
    struct pool_job *job = pool_queue_first(&flow->queue);
    if (call && job && job->priority > call->run->job->priority)
        call = NULL;
    return (struct pool_work){call, call ? NULL : job};
}

/*
 * Brings the time of a flow that gets work into the range described above. A flow that has work already is in this
 * range, or nearly so.
 */
static void limit_time(struct pool *pool, struct pool_flow *flow, uint64_t now)
{
    uint64_t time = pool_time_at(&flow->time, now), most = pool->level + (uint64_t)MAX_DEBT_NS * pool->threads;
    flow->time.base += (time < pool->level ? pool->level : time > most ? most : time) - time;
}

/* The pool's active time begins; a pause shorter than POOL_PAUSE_NS counts as active. */
static void open_pool(struct pool *pool, uint64_t now)
{
    pool->open.base -= now - pool->closed_ns < POOL_PAUSE_NS ? pool->closed_ns : now;
    pool->open.threads = 1;
}

static void close_pool(struct pool *pool, uint64_t now)
{
    pool->open.base += now;
    pool->open.threads = 0;
    pool->closed_ns = now;
}

static void open_job(struct pool *pool, struct pool_flow *flow, uint64_t now)
{
    if (!pool->flows.first)
        open_pool(pool, now);
    if (flow->open++ == 0)
        list_append(&pool->flows, &flow->link);
}

void pool_flows_close_job(struct pool *pool, const struct pool_job *job, uint64_t now)
{
    struct pool_flow *flow = job->flow;
    if (--flow->open > 0)
        return;
    list_remove(&pool->flows, &flow->link);
    if (!pool->flows.first)
        close_pool(pool, now);
}

void pool_flows_add_job(struct pool *pool, struct pool_job *job, uint64_t now)
{
    unsigned class = pool_queue_class(job->size);
    limit_time(pool, job->flow, now);
    open_job(pool, job->flow, now);
    pool_queue_put(&job->flow->queue, job);
    pool->queued++;
    pool->queued_of[class]++;
    pool->queued_classes |= UINT64_C(1) << class;
}

void pool_flows_take_job(struct pool *pool, struct pool_job *job)
{
    unsigned class = pool_queue_class(job->size);
    pool_queue_remove(&job->flow->queue, job);
    pool->queued--;
    if (--pool->queued_of[class] == 0)
        pool->queued_classes &= ~(UINT64_C(1) << class);
}

void pool_flows_add_call(struct pool *pool, struct pool_call *call, uint64_t now)
{
    struct pool_flow *flow = call->run->job->flow;
    limit_time(pool, flow, now);
    struct pool_call **link = &flow->calls;
    while (*link && !pool_queue_before(call->run->job, (*link)->run->job))
        link = &(*link)->after;
    call->after = *link;
    *link = call;
}

void pool_flows_remove_call(struct pool_call *call)
{
    struct pool_call **link = &call->run->job->flow->calls;
    while (*link != call)
        link = &(*link)->after;
    *link = call->after;
}

/*
 * Returns the work of the flow with the least time, among those that have work. The time of `favoured` (or NULL) counts
 * as less by FAVOUR_NS.
 */
static struct pool_work least_served(struct pool *pool, const struct pool_flow *favoured, uint64_t now)
{
    struct pool_work best = {NULL, NULL};
    uint64_t least = UINT64_MAX, level = 0;
    for (struct list_link *link = pool->flows.first; link; link = link->next) {
        struct pool_flow *flow = container_of(link, struct pool_flow, link);
        uint64_t time = pool_time_at(&flow->time, now), favour = flow == favoured ? FAVOUR_NS : 0;
        uint64_t claim = time > favour ? time - favour : 0;
        struct pool_work work = claim < least ? work_of(flow) : (struct pool_work){NULL, NULL};
        if (!work.call && !work.job)
            continue;
        best = work;
        least = claim;
        level = time;
    }
    if (level > pool->level)
        pool->level = level;
    return best;
}

struct pool_work pool_flows_next(struct pool *pool, uint64_t now)
{
    return least_served(pool, NULL, now);
}

bool pool_flows_leave(struct pool *pool, const struct pool_call *call, uint64_t now)
{
    /*
     * A spare thread has started a job, so more threads than there are workers are busy, and only helpers can stop
     * early.
     */
    if (pool->active > pool->threads)
        return true;
    return least_served(pool, call->run->job->flow, now).call != call;
}

/* The largest size of a job that a spare thread may start while this job runs, or 0 if none may start. */
static uint64_t size_beside(const struct pool_job *job)
{
    uint64_t size = pool_queue_size(job);
    return size < POOL_SPARE_LEAST ? 0 : size / POOL_SPARE_RATIO;
}

/* The largest size of a job that a spare thread may start beside all running jobs; 0 when it is less than `enough`. */
static uint64_t spare_size(const struct pool *pool, uint64_t enough)
{
    uint64_t size = UINT64_MAX;
    for (struct list_link *link = pool->runs.first; link; link = link->next) {
        uint64_t most = size_beside(container_of(link, struct pool_run, link)->job);
        size = most < size ? most : size;
        if (size < enough)
            return 0;
    }
    return size;
}

struct pool_job *pool_flows_spare_job(const struct pool *pool, uint64_t now)
{
    if (pool->queued == 0)
        return NULL;
    uint64_t smallest = UINT64_C(1) << __builtin_ctzll(pool->queued_classes), size = spare_size(pool, smallest),
             least = UINT64_MAX;
    struct pool_job *best = NULL;
    for (struct list_link *link = size > 0 ? pool->flows.first : NULL; link; link = link->next) {
        const struct pool_flow *flow = container_of(link, struct pool_flow, link);
        uint64_t time = pool_time_at(&flow->time, now);
        struct pool_job *job = time < least ? pool_queue_first_small(&flow->queue, size) : NULL;
        if (job) {
            best = job;
            least = time;
        }
    }
    return best;
}
