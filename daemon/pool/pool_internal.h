/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pool_internal.h - the structs and functions that the files of the pool share. Unless a comment says otherwise, fields
 * are protected by the pool's lock, and functions are called, and return, with the lock held. `now` is always a time
 * in nanoseconds (clock_ns) that was read while the lock was held.
 *
 * pool.c is the interface to the loop. pool_threads.c has the threads, and decides which of them are woken.
 * pool_flows.c decides which work is next. pool_calls.c is the for_each of struct parallel.
 */
#ifndef BVHD_POOL_INTERNAL_H
#define BVHD_POOL_INTERNAL_H

#include <pthread.h>
#include <semaphore.h>

#include "proto/base/clock.h"
#include "proto/base/list.h"
#include "daemon/pool/pool.h"
#include "daemon/pool/pool_queue.h"
#include "daemon/pool/turns.h"

enum { POOL_SPARE_THREADS = 2, POOL_CACHE_LINE = 64 };

/* How often a thread checks for work before it sleeps: this takes about 10 us, as much as a sleep and a wake cost. */
enum { POOL_SPIN_ROUNDS = 250 };

enum pool_job_state { POOL_JOB_NEW = 0, POOL_JOB_QUEUED, POOL_JOB_RUNNING, POOL_JOB_ENDED };

/*
 * A sum of the time that threads spend on something, including those that are still busy with it: base + threads * now.
 * It is computed modulo 2^64, so it is exact wherever the clock starts.
 */
struct pool_time {
    uint64_t base;
    uint64_t threads; /* busy with it now */
};

static inline uint64_t pool_time_at(const struct pool_time *time, uint64_t now)
{
    return time->base + time->threads * now;
}

/* From `now` on, that many more threads, or fewer, are busy with it. */
static inline void pool_time_add(struct pool_time *time, uint64_t threads, uint64_t now)
{
    time->base -= threads * now;
    time->threads += threads;
}

static inline void pool_time_remove(struct pool_time *time, uint64_t threads, uint64_t now)
{
    time->base += threads * now;
    time->threads -= threads;
}

/*
 * The fields that are read in every flow whenever a thread looks for work come first, so that they share a cache line.
 */
struct pool_flow {
    struct pool_time time; /* for the order of flows */
    struct list_link link; /* in parent->flows */
    struct list flows; /* those within it that have open jobs; it then has no jobs of its own */
    struct pool_flow *parent; /* constant; only the pool's root has none */
    uint64_t level; /* the time of the flow within it that was served last; a new flow starts there */
    /* open calls, by priority of their jobs, then by age of their jobs, then by their own age */
    struct pool_call *calls;
    uint32_t open; /* jobs queued or running, in flows within it, too; it is in parent->flows while there are any */
    /* jobs submitted and not done, and flows within it; only the loop thread uses it, without the lock */
    uint32_t jobs;
    bool ended; /* by pool_flow_end; only the loop thread uses it, without the lock */
    struct pool_queue queue;
    struct pool_time busy; /* what its jobs, and those of the flows within it, have really had */
};

/* A running job, on the stack of the thread that runs it. `parallel` is the job's interface to the pool. */
struct pool_run {
    struct parallel parallel;
    struct pool *pool;
    struct pool_job *job;
    struct list_link link; /* in pool.runs */
    unsigned threads; /* whose time counts for the job's flow now */
};

/* One call of for_each, on the stack of its caller. Its fields are constant unless a comment says otherwise. */
struct pool_call {
    parallel_task task;
    void *context;
    size_t count;
    struct pool_run *run;
    struct pool_call *parent; /* the call whose task made this one, or NULL */
    atomic_size_t next; /* the first task that no thread has taken; may exceed count */
    atomic_uint helpers; /* threads besides the caller that work on the call; changed under the lock */
    struct pool_call *after; /* the next in the flow's list; under the lock */
    struct pool_thread *sleeper; /* the calling thread while it sleeps, else NULL; under the lock */
};

struct pool_thread {
    struct pool *pool; /* constant */
    pthread_t id; /* used only by the thread that starts and stops the pool */
    sem_t wake; /* used without the lock: posted once by the thread that takes this one off a list of sleepers */
    struct pool_thread *next; /* in pool.idle, then in pool.to_wake */
    struct turns turns; /* only the thread itself uses it, without the lock */
};

struct pool {
    pthread_mutex_t lock;
    unsigned threads; /* workers, without the spare threads; constant */
    void (*wake)(void *context); /* constant */
    void *wake_context; /* constant */

    struct pool_flow root; /* around the flows that are within no other */
    struct list runs; /* running jobs */
    uint32_t queued, running; /* jobs */
    uint32_t queued_of[POOL_QUEUE_CLASSES]; /* queued jobs by class of size */
    uint64_t queued_classes; /* bit i is set while class i has queued jobs */
    unsigned active; /* threads that are in jobs and calls, also while they wait there for helpers */
    uint64_t orders; /* jobs submitted so far */
    struct pool_time open; /* counts one thread while there are jobs */
    uint64_t closed_ns; /* when the last job ended, while there are none */
    uint64_t jobs_done;
    bool stop;

    struct pool_thread *idle; /* sleeping threads, the one that slept last first */
    unsigned spinning; /* threads without work that have not gone to sleep */
    unsigned called_spinning; /* spinning threads that have been called to look for work */
    unsigned coming; /* threads that will look for work: called spinning ones, and those that were woken */

    struct pool_job *ended, **ended_end; /* for pool_collect, oldest first */

    /* Wakeups that are due; pool_unlock does them after it has opened the lock. */
    struct pool_thread *to_wake; /* threads to post */
    bool wake_is_due; /* whether to call `wake` */

    unsigned started; /* threads of all_threads that run; constant after the start */
    char padding_before[POOL_CACHE_LINE]; /* keeps `posted`, which is read without the lock, in its own cache line */
    atomic_uint posted; /* changes when there is work for a spinning thread; written under the lock */
    char padding_after[POOL_CACHE_LINE];
    struct pool_thread all_threads[];
};

static inline void pool_lock(struct pool *pool)
{
    pthread_mutex_lock(&pool->lock);
}

/* Opens the lock, then wakes the threads in to_wake, and the loop if wake_is_due. */
void pool_unlock(struct pool *pool);

/* pool.c */

/* Appends a job to the list for pool_collect; the loop is woken if the list was empty. */
void pool_append_ended(struct pool *pool, struct pool_job *job);

/* pool_threads.c */

/*
 * Starts all threads; called without the lock. Returns 0 or an errno value. After an error some threads may run; they
 * are stopped by pool_threads_stop.
 */
int pool_threads_start(struct pool *pool);

/* Stops and joins the threads that were started; called without the lock. */
void pool_threads_stop(struct pool *pool);

/* Returns the calling thread if it belongs to a pool, else NULL. Called with or without the lock. */
struct pool_thread *pool_threads_self(void);

/* Arranges that a thread that was just taken off a list of sleepers is posted by pool_unlock. */
void pool_threads_wake(struct pool *pool, struct pool_thread *thread);

/* Sleeps until pool_threads_wake; opens the lock meanwhile. */
void pool_threads_sleep(struct pool *pool, struct pool_thread *self);

/*
 * Calls up to `count` free threads, because there is new work for that many. If there are too few, it calls a spare
 * thread when there is a job that one may start.
 */
void pool_threads_call(struct pool *pool, size_t count, uint64_t now);

/* From `now` on, that many more threads, or fewer, work for the flow and for those around it. */
static inline void pool_flow_add_threads(struct pool_flow *flow, uint64_t threads, uint64_t now)
{
    for (; flow; flow = flow->parent) {
        pool_time_add(&flow->time, threads, now);
        pool_time_add(&flow->busy, threads, now);
    }
}

static inline void pool_flow_remove_threads(struct pool_flow *flow, uint64_t threads, uint64_t now)
{
    for (; flow; flow = flow->parent) {
        pool_time_remove(&flow->time, threads, now);
        pool_time_remove(&flow->busy, threads, now);
    }
}

/* From `now` on, the calling thread's time counts for the flow of the job. */
void pool_threads_resume(struct pool_run *run, uint64_t now);

/* From `now` on, the calling thread's time does not count for the flow of the job. */
void pool_threads_pause(struct pool_run *run, uint64_t now);

/* pool_flows.c */

/* The next work of a thread: tasks of a call, or a queued job. One of them is NULL, or both if there is no work. */
struct pool_work {
    struct pool_call *call;
    struct pool_job *job;
};

/* Puts a job into the queue of its flow. */
void pool_flows_add_job(struct pool *pool, struct pool_job *job, uint64_t now);

/* Takes a job out of the queue of its flow, to be run or because it was cancelled. */
void pool_flows_take_job(struct pool *pool, struct pool_job *job);

/* A job that was taken has ended at `now`. */
void pool_flows_close_job(struct pool *pool, const struct pool_job *job, uint64_t now);

/* Returns whether a job of that priority would have its turn earlier in `flow` than this job has it where it is. */
bool pool_flows_is_earlier(const struct pool_flow *flow, int priority, const struct pool_job *job, uint64_t now);

/* Moves a job that is queued or running to another flow, with its calls and the threads that work for it. */
void pool_flows_move_job(struct pool *pool, struct pool_job *job, struct pool_flow *flow, int priority, uint64_t now);

/* Puts a call into the list of its flow, and takes it out. */
void pool_flows_add_call(struct pool *pool, struct pool_call *call, uint64_t now);
void pool_flows_remove_call(struct pool_call *call);

/* Returns what a free worker is to do next. */
struct pool_work pool_flows_next(struct pool *pool, uint64_t now);

/* Returns whether a helper of this call has to stop and look for other work. */
bool pool_flows_leave(struct pool *pool, const struct pool_call *call, uint64_t now);

/* Returns the job that a spare thread may start, or NULL when there is none. */
struct pool_job *pool_flows_spare_job(const struct pool *pool, uint64_t now);

/* pool_calls.c */

/* Returns whether some tasks of the call have not been taken. Called with or without the lock. */
static inline bool pool_calls_has_tasks(const struct pool_call *call)
{
    return atomic_load_explicit(&call->next, memory_order_relaxed) < call->count;
}

/* The for_each of a run's `parallel`; called without the lock. */
void pool_calls_for_each(const struct parallel *parallel, size_t count, parallel_task task, void *context);

/*
 * Runs tasks of a call on a free thread until all tasks have been taken or pool_flows_leave says to stop. The lock is
 * open while tasks run.
 */
void pool_calls_help(struct pool *pool, struct pool_call *call, uint64_t now);

#endif
