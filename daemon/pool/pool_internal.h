/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pool_internal.h - what the files of the pool share. Fields without a word are under the pool's lock, and so are
 * functions: they are called, and return, with the lock held. `now` is always a time read under it.
 *
 * pool.c: what the loop sees. pool_threads.c: threads that take work, and who is woken for what. pool_flows.c: which
 * work is next. pool_calls.c: for_each.
 */
#ifndef BVHD_POOL_INTERNAL_H
#define BVHD_POOL_INTERNAL_H

#include <pthread.h>
#include <semaphore.h>

#include "proto/base/clock.h"
#include "proto/base/list.h"
#include "daemon/pool/pool.h"
#include "daemon/pool/pool_queue.h"

enum { POOL_SPARE_THREADS = 2, POOL_CACHE_LINE = 64 };

/* Rounds of looking before sleeping: about 10 us, what a sleep and a wake would cost. */
enum { POOL_SPIN_ROUNDS = 250 };

enum pool_job_state { POOL_JOB_NEW = 0, POOL_JOB_QUEUED, POOL_JOB_RUNNING, POOL_JOB_ENDED };

/*
 * Time that threads spend on something, all together, those still at it included. Modular, so that it is exact for any
 * start of the clock.
 */
struct pool_time {
    uint64_t base;
    uint64_t threads; /* at it now */
};

static inline uint64_t pool_time_at(const struct pool_time *time, uint64_t now)
{
    return time->base + time->threads * now;
}

/* What is looked at in each flow whenever a thread wants work comes first, to be in one line of the cache. */
struct pool_flow {
    struct pool_time time;
    struct list_link link; /* in the pool's list */
    struct pool_call *calls; /* open ones: by priority, then age of their jobs, then age */
    uint32_t open; /* jobs queued or running: the flow is in the list while there are any */
    uint32_t jobs; /* submitted and not done; loop only */
    bool ended; /* loop only */
    struct pool_queue queue;
};

/* A job that runs; lives on the stack of the thread that runs it. `parallel` is what the job sees of the pool. */
struct pool_run {
    struct parallel parallel;
    struct pool *pool;
    struct pool_job *job;
    struct list_link link; /* in the pool's list */
};

/* One call of for_each; lives on its caller's stack. Constant where nothing else is said. */
struct pool_call {
    parallel_task task;
    void *context;
    size_t count;
    const struct pool_run *run;
    struct pool_call *parent; /* the call whose task made this one */
    atomic_size_t next; /* the first task that nobody has taken; may pass count */
    atomic_uint helpers; /* threads inside besides the caller; changed under the lock */
    struct pool_call *after; /* in the flow's list; under the lock */
    struct pool_thread *sleeper; /* its caller, while it sleeps; under the lock */
};

struct pool_thread {
    struct pool *pool; /* constant */
    pthread_t id; /* for the thread that starts and stops the pool */
    sem_t wake; /* not under the lock: who takes the thread off a list of sleepers posts it, once */
    struct pool_thread *next; /* among the idle, then among those to be woken */
};

struct pool {
    pthread_mutex_t lock;
    unsigned threads; /* workers; spare threads come on top; constant */
    void (*wake)(void *context); /* constant */
    void *wake_context;

    struct list flows; /* with open jobs */
    struct list runs;
    uint32_t queued, running; /* jobs */
    uint32_t queued_of[POOL_QUEUE_CLASSES]; /* jobs, by class of size */
    uint64_t queued_classes; /* bit i: class i has some */
    unsigned active; /* threads that are in jobs and calls, also while they wait there for helpers */
    uint64_t orders;
    uint64_t level; /* the time of the flow that was last served: where a flow without a past starts */
    struct pool_time busy;
    struct pool_time open; /* counts 1 while there are jobs */
    uint64_t closed_ns; /* when there were none any more */
    uint64_t jobs_done;
    bool stop;

    struct pool_thread *idle; /* asleep, the last first */
    unsigned spinning; /* threads without work that have not gone to sleep */
    unsigned promised; /* of these, how many have been told to look again */
    unsigned coming; /* threads that are on their way to look for work: promised ones and woken ones */

    struct pool_job *ended, **ended_end; /* for pool_collect, oldest first */

    struct pool_thread *to_wake; /* errands of the thread that holds the lock, for pool_unlock */
    bool to_tell;

    unsigned started; /* of all_threads; constant after the start */
    char apart
        [POOL_CACHE_LINE]; /* what threads look at without the lock is not in a line with what changes all the time */
    atomic_uint posted; /* changes when work comes for a spinning thread; written under the lock */
    char apart_too[POOL_CACHE_LINE];
    struct pool_thread all_threads[];
};

static inline void pool_lock(struct pool *pool)
{
    pthread_mutex_lock(&pool->lock);
}

/* Opens the lock, then wakes who was called meanwhile. */
void pool_unlock(struct pool *pool);

/* pool.c */

void pool_append_ended(struct pool *pool, struct pool_job *job);

/* pool_threads.c */

/* Without the lock. Returns 0 or an errno value; threads that were started by then are there to be stopped. */
int pool_threads_start(struct pool *pool);
void pool_threads_stop(struct pool *pool);

/* The pool's thread that calls, NULL for any other. With or without the lock. */
struct pool_thread *pool_threads_self(void);

/* Posts to a thread that has just been taken off a list of sleepers, once the lock is open. */
void pool_threads_wake(struct pool *pool, struct pool_thread *thread);

/* Sleeps until pool_threads_wake; opens the lock meanwhile. */
void pool_threads_sleep(struct pool *pool, struct pool_thread *self);

/*
 * After work has come for `count` threads: calls those that are free; when there are too few, a spare one where that is
 * due.
 */
void pool_threads_call(struct pool *pool, size_t count, uint64_t now);

/* The calling thread spends time on a flow from here on, or no longer. */
void pool_threads_resume(struct pool *pool, struct pool_flow *flow, uint64_t now);
void pool_threads_pause(struct pool *pool, struct pool_flow *flow, uint64_t now);

/* pool_flows.c */

/* Exactly one of call and job, or nothing at all. */
struct pool_work {
    struct pool_call *call;
    struct pool_job *job;
};

/* A job waits, and no longer waits. */
void pool_flows_add_job(struct pool *pool, struct pool_job *job, uint64_t now);
void pool_flows_take_job(struct pool *pool, struct pool_job *job);

/* A job that was taken has ended, at `now`. */
void pool_flows_close_job(struct pool *pool, const struct pool_job *job, uint64_t now);

void pool_flows_add_call(struct pool *pool, struct pool_call *call, uint64_t now);
void pool_flows_remove_call(struct pool_call *call);

/* What a free worker does next. */
struct pool_work pool_flows_next(struct pool *pool, uint64_t now);

/* Whether a helper of this call should look for other work. */
bool pool_flows_leave(struct pool *pool, const struct pool_call *call, uint64_t now);

/* The job that a spare thread may start; NULL when there is none. */
struct pool_job *pool_flows_spare_job(const struct pool *pool, uint64_t now);

/* pool_calls.c */

/* With or without the lock. */
static inline bool pool_calls_has_tasks(const struct pool_call *call)
{
    return atomic_load_explicit(&call->next, memory_order_relaxed) < call->count;
}

/* The for_each of a run's parallel; without the lock. */
void pool_calls_for_each(const struct parallel *parallel, size_t count, parallel_task task, void *context);

/*
 * A free thread works on a call until its tasks are given out or other work is due. The lock is open while tasks run.
 */
void pool_calls_help(struct pool *pool, struct pool_call *call, uint64_t now);

#endif
