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

/*
 * Returns the first work of a flow with jobs of its own: tasks of its first open call, unless a queued job has a higher
 * priority.
 */
static struct pool_work work_of(const struct pool_flow *flow)
{
    struct pool_call *call = open_call(flow);
    struct pool_job *job = pool_queue_first(&flow->queue);
    if (call && job && job->priority > call->run->job->priority)
        call = NULL;
    return (struct pool_work){call, call ? NULL : job};
}

/* The time of a flow that gets work, brought into the range described above. */
static uint64_t limited_time(const struct pool *pool, const struct pool_flow *flow, uint64_t now)
{
    uint64_t time = pool_time_at(&flow->time, now), level = flow->parent->level,
             most = level + (uint64_t)MAX_DEBT_NS * pool->threads;
    return time < level ? level : time > most ? most : time;
}

/* Limits the times of a flow that gets work and of the one around it. If they have work already, they are in range. */
static void limit_times(struct pool *pool, struct pool_flow *flow, uint64_t now)
{
    for (; flow->parent; flow = flow->parent)
        flow->time.base += limited_time(pool, flow, now) - pool_time_at(&flow->time, now);
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
    if (!pool->root.flows.first)
        open_pool(pool, now);
    for (; flow->parent; flow = flow->parent)
        if (flow->open++ == 0)
            list_append(&flow->parent->flows, &flow->link);
}

static void close_job(struct pool *pool, struct pool_flow *flow, uint64_t now)
{
    for (; flow->parent; flow = flow->parent)
        if (--flow->open == 0)
            list_remove(&flow->parent->flows, &flow->link);
    if (!pool->root.flows.first)
        close_pool(pool, now);
}

void pool_flows_close_job(struct pool *pool, const struct pool_job *job, uint64_t now)
{
    close_job(pool, job->flow, now);
}

void pool_flows_add_job(struct pool *pool, struct pool_job *job, uint64_t now)
{
    unsigned class = pool_queue_class(job->size);
    limit_times(pool, job->flow, now);
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

/* Inserts the call into the list of its flow, which is in the order of the jobs. */
static void list_call(struct pool_call *call)
{
    struct pool_call **link = &call->run->job->flow->calls;
    while (*link && !pool_queue_before(call->run->job, (*link)->run->job))
        link = &(*link)->after;
    call->after = *link;
    *link = call;
}

void pool_flows_add_call(struct pool *pool, struct pool_call *call, uint64_t now)
{
    limit_times(pool, call->run->job->flow, now);
    list_call(call);
}

void pool_flows_remove_call(struct pool_call *call)
{
    struct pool_call **link = &call->run->job->flow->calls;
    while (*link != call)
        link = &(*link)->after;
    *link = call->after;
}

/* ---- a job that changes its flow ---- */

/* The time by which a flow's turn is decided: if it has no work, that which it would have if it got some. */
static uint64_t turn_of(const struct pool_flow *flow, uint64_t now)
{
    uint64_t time = pool_time_at(&flow->time, now);
    return flow->open == 0 && time < flow->parent->level ? flow->parent->level : time;
}

bool pool_flows_is_earlier(const struct pool_flow *flow, int priority, const struct pool_job *job, uint64_t now)
{
    const struct pool_flow *other = job->flow;
    if (flow == other)
        return priority > job->priority;
    if (flow->parent != other->parent) {
        flow = flow->parent->parent ? flow->parent : flow;
        other = other->parent->parent ? other->parent : other;
    }
    return turn_of(flow, now) < turn_of(other, now);
}

static struct pool_run *run_of(const struct pool *pool, const struct pool_job *job)
{
    struct list_link *link = pool->runs.first;
    while (container_of(link, struct pool_run, link)->job != job)
        link = link->next;
    return container_of(link, struct pool_run, link);
}

/* Takes the calls of the run off the list of its flow. Returns them, linked in their order. */
static struct pool_call *take_calls(const struct pool_run *run)
{
    struct pool_call *taken = NULL, **end = &taken, **link = &run->job->flow->calls;
    while (*link) {
        struct pool_call *call = *link;
        if (call->run != run) {
            link = &call->after;
            continue;
        }
        *link = call->after;
        *end = call;
        end = &call->after;
    }
    *end = NULL;
    return taken;
}

/* Moves a running job. Its threads' time counts for the new flow from now on. */
static void move_run(struct pool *pool, struct pool_run *run, struct pool_flow *flow, int priority, uint64_t now)
{
    struct pool_flow *old = run->job->flow;
    struct pool_call *calls = take_calls(run);
    limit_times(pool, flow, now);
    open_job(pool, flow, now);
    pool_flow_remove_threads(old, run->threads, now);
    pool_flow_add_threads(flow, run->threads, now);
    run->job->flow = flow;
    run->job->priority = priority;
    while (calls) {
        struct pool_call *call = calls;
        calls = call->after;
        list_call(call);
    }
    close_job(pool, old, now);
}

void pool_flows_move_job(struct pool *pool, struct pool_job *job, struct pool_flow *flow, int priority, uint64_t now)
{
    if (job->state == POOL_JOB_RUNNING) {
        move_run(pool, run_of(pool, job), flow, priority, now);
        return;
    }
    struct pool_flow *old = job->flow;
    pool_flows_take_job(pool, job);
    job->flow = flow;
    job->priority = priority;
    pool_flows_add_job(pool, job, now);
    close_job(pool, old, now);
}

/* ---- what is next ---- */

static bool is_around(const struct pool_flow *flow, const struct pool_flow *inner)
{
    while (inner && inner != flow)
        inner = inner->parent;
    return inner != NULL;
}

/*
 * Returns the work of the flow with the least time within `parent`, among those that have work. The times of `favoured`
 * (or NULL) and of the flow around it count as less by FAVOUR_NS.
 */
static struct pool_work least_served(struct pool_flow *parent, const struct pool_flow *favoured, uint64_t now)
{
    struct pool_work best = {NULL, NULL};
    uint64_t least = UINT64_MAX, level = 0;
    for (struct list_link *link = parent->flows.first; link; link = link->next) {
        struct pool_flow *flow = container_of(link, struct pool_flow, link);
        uint64_t time = pool_time_at(&flow->time, now), favour = is_around(flow, favoured) ? FAVOUR_NS : 0;
        uint64_t claim = time > favour ? time - favour : 0;
        if (claim >= least)
            continue;
        struct pool_work work = flow->flows.first ? least_served(flow, favoured, now) : work_of(flow);
        if (!work.call && !work.job)
            continue;
        best = work;
        least = claim;
        level = time;
    }
    if (level > parent->level)
        parent->level = level;
    return best;
}

struct pool_work pool_flows_next(struct pool *pool, uint64_t now)
{
    return least_served(&pool->root, NULL, now);
}

bool pool_flows_leave(struct pool *pool, const struct pool_call *call, uint64_t now)
{
    /*
     * A spare thread has started a job, so more threads than there are workers are busy, and only helpers can stop
     * early.
     */
    if (pool->active > pool->threads)
        return true;
    return least_served(&pool->root, call->run->job->flow, now).call != call;
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

/* Returns the job of at most that size whose flow within `parent` has the least time, or NULL. */
static struct pool_job *small_job(const struct pool_flow *parent, uint64_t size, uint64_t now)
{
    uint64_t least = UINT64_MAX;
    struct pool_job *best = NULL;
    for (struct list_link *link = parent->flows.first; link; link = link->next) {
        const struct pool_flow *flow = container_of(link, struct pool_flow, link);
        uint64_t time = pool_time_at(&flow->time, now);
        if (time >= least)
            continue;
        struct pool_job *job =
            flow->flows.first ? small_job(flow, size, now) : pool_queue_first_small(&flow->queue, size);
        if (job) {
            best = job;
            least = time;
        }
    }
    return best;
}

struct pool_job *pool_flows_spare_job(const struct pool *pool, uint64_t now)
{
    if (pool->queued == 0)
        return NULL;
    uint64_t smallest = UINT64_C(1) << __builtin_ctzll(pool->queued_classes), size = spare_size(pool, smallest);
    return size > 0 ? small_job(&pool->root, size, now) : NULL;
}
