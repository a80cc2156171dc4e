/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/pool/pool_internal.h"

#include "proto/base/processor.h"

/*
 * How long a helper runs tasks before it checks for more urgent work: long enough to cause no contention on the lock.
 */
enum { ROUND_NS = 1000 * 1000 };

/* The innermost call of which this thread is running a task. */
static _Thread_local struct pool_call *current;

/* Runs the next task of the call. Returns false when all have been taken. */
static bool run_task(struct pool_call *call)
{
    size_t index = atomic_fetch_add_explicit(&call->next, 1, memory_order_relaxed);
    if (index >= call->count)
        return false;
    call->task(call->context, index);
    return true;
}

static void run_tasks(struct pool_call *call)
{
    struct pool_call *outer = current;
    current = call;
    while (run_task(call))
        continue;
    current = outer;
}

/* Runs tasks until none are left or the time is `until`. */
static void run_round(struct pool_call *call, uint64_t until)
{
    current = call;
    while (run_task(call) && clock_ns() < until)
        continue;
    current = NULL;
}

static void enter(struct pool_call *call)
{
    atomic_fetch_add_explicit(&call->helpers, 1, memory_order_relaxed);
}

static void leave(struct pool *pool, struct pool_call *call)
{
    if (atomic_fetch_sub_explicit(&call->helpers, 1, memory_order_release) > 1 || !call->sleeper)
        return;
    pool_threads_wake(pool, call->sleeper);
    call->sleeper = NULL;
}

void pool_calls_help(struct pool *pool, struct pool_call *call, uint64_t now)
{
    enter(call);
    do {
        pool_unlock(pool);
        run_round(call, now + ROUND_NS);
        pool_lock(pool);
        now = clock_ns();
    } while (pool_calls_has_tasks(call) && !pool_flows_leave(pool, call, now));
    leave(pool, call);
}

static bool descends_from(const struct pool_call *call, const struct pool_call *ancestor)
{
    for (call = call->parent; call; call = call->parent)
        if (call == ancestor)
            return true;
    return false;
}

/* Returns a call that was made, directly or not, by a task of this call and has tasks left, or NULL. */
static struct pool_call *open_below(const struct pool_call *call)
{
    for (struct pool_call *other = call->run->job->flow->calls; other; other = other->after)
        if (other->run == call->run && pool_calls_has_tasks(other) && descends_from(other, call))
            return other;
    return NULL;
}

static void open_call(struct pool *pool, struct pool_call *call)
{
    pool_lock(pool);
    uint64_t now = clock_ns();
    pool_flows_add_call(pool, call, now);
    for (struct pool_call *ancestor = call->parent; ancestor; ancestor = ancestor->parent)
        if (ancestor->sleeper) {
            pool_threads_wake(pool, ancestor->sleeper);
            ancestor->sleeper = NULL;
        }
    pool_threads_call(pool, call->count - 1, now);
    pool_unlock(pool);
}

static void spin_for_helpers(const struct pool_call *call)
{
    for (int i = 0; i < POOL_SPIN_ROUNDS && atomic_load_explicit(&call->helpers, memory_order_relaxed) > 0; i++)
        processor_relax();
}

/*
 * Sleeps until the last helper has left the call or one of its tasks makes a call. This time does not count for the
 * flow.
 */
static void sleep_as_caller(struct pool *pool, struct pool_call *call, struct pool_thread *self)
{
    call->sleeper = self;
    pool_threads_pause(call->run, clock_ns());
    pool_threads_sleep(pool, self);
    pool_threads_resume(call->run, clock_ns());
}

/*
 * While the caller waits, it helps only with calls that descend from its own. A task of any other call could keep it
 * from going on after its helpers have left.
 */
static void wait_for_helpers(struct pool *pool, struct pool_call *call, struct pool_thread *self)
{
    while (atomic_load_explicit(&call->helpers, memory_order_acquire) > 0) {
        struct pool_call *below = open_below(call);
        if (below) {
            enter(below);
            pool_unlock(pool);
            run_tasks(below);
            pool_lock(pool);
            leave(pool, below);
        } else {
            sleep_as_caller(pool, call, self);
        }
    }
}

/* Once the call is off the flow's list, no more helpers join it. */
static void close_call(struct pool *pool, struct pool_call *call, struct pool_thread *self)
{
    pool_lock(pool);
    pool_flows_remove_call(call);
    if (atomic_load_explicit(&call->helpers, memory_order_acquire) > 0) {
        pool_unlock(pool);
        spin_for_helpers(call);
        pool_lock(pool);
        wait_for_helpers(pool, call, self);
    }
    pool_unlock(pool);
}

void pool_calls_for_each(const struct parallel *parallel, size_t count, parallel_task task, void *context)
{
    struct pool_run *run = (struct pool_run *)(uintptr_t)parallel;
    struct pool_thread *self = pool_threads_self();
    if (count <= 1 || run->pool->threads == 1 || !self || self->pool != run->pool) {
        parallel_serial.for_each(&parallel_serial, count, task, context);
        return;
    }
    struct pool_call call = {
        .task = task,
        .context = context,
        .count = count,
        .run = run,
        .parent = current && current->run == run ? current : NULL,
    };
    open_call(run->pool, &call);
    run_tasks(&call);
    close_call(run->pool, &call, self);
}
