/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pool.h - the worker threads of the service, and the order in which they take jobs.
 *
 * A job is one call of run() on a worker. The tasks that run() passes to its struct parallel are distributed over the
 * workers that are free. A flow is an account with the pool: the time that the jobs of one connection have had, and in
 * a flow around those of a user's connections the time of all of them. After each task or job a worker chooses its next
 * work:
 *
 * * among flows, it takes the one that has had the least time so far (a flow that returns after a pause starts level
 *   with the others), and among the flows within that one it does the same, so that a user with many connections has
 *   the time of one user;
 * * within a flow, it takes the highest priority; among equal priorities the unfinished tasks of a running job come
 *   before a queued job, and older jobs before newer ones.
 *
 * A running job keeps its thread. To spare a small job from waiting for a large one, there are a few spare threads
 * beside the workers. One of them starts a queued job only while all workers are busy, and every running job is at
 * least POOL_SPARE_RATIO times as large as the queued one and has a size of POOL_SPARE_LEAST or more: smaller ones end
 * soon by themselves. The system's scheduler then shares the processors.
 *
 * All functions are called from one thread, the loop. run() is called on a worker, and `wake` on any thread.
 */
#ifndef BVHD_POOL_H
#define BVHD_POOL_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "proto/base/parallel.h"
#include "proto/base/status.h"

enum {
    POOL_SPARE_RATIO = 8,
    POOL_SPARE_LEAST = 8192, /* in the unit of pool_job.size */
    POOL_MAX_THREADS = 1024,
    POOL_PAUSE_NS = 10 * 1000 * 1000, /* a pause without jobs that is shorter counts as active time */
    POOL_COLLECT_MOST = 64 /* jobs that one call of pool_collect finishes */
};

struct pool;
struct pool_flow;

/*
 * A job is memory of its owner, which has to stay valid from pool_submit until done() is called. The owner zeroes it
 * and fills the first group of fields; the second group belongs to the pool.
 */
struct pool_job {
    /*
     * Called on a worker. It checks `cancel` itself. `parallel` is valid for run() and its tasks, until run() returns;
     * a call of its for_each from any other thread runs all tasks on that thread.
     */
    void (*run)(struct pool_job *job, const struct parallel *parallel);
    void (*done)(struct pool_job *job); /* called on the loop, by pool_collect; the job is its owner's again */
    struct pool_flow *flow;
    uint64_t size; /* how much work it is, in primitives or similar units; decides whether a spare thread starts it */
    int priority; /* within a flow; a higher one goes first */
    atomic_bool cancel; /* set by pool_cancel, checked by run() */

    bool ran; /* for done() to read: false when the job was cancelled in the queue */
    uint64_t submitted_ns, started_ns, ended_ns; /* CLOCK_MONOTONIC; the last two are 0 if the job did not run */
    int state; /* an enum pool_job_state, under the pool's lock */
    uint64_t order; /* the number of jobs submitted before this one */
    struct pool_job *next, *previous, *child; /* links of the flow's queue, then of the list of ended jobs */
};

/*
 * Starts `threads` workers, or one for each processor that this process is allowed to use if `threads` is 0, and the
 * spare threads. `wake` is called, on any thread, whenever pool_collect has something to do after it had nothing; it
 * must only cause the loop to call pool_collect (uv_async_send). Errors: BVHD_TOO_LARGE for more than POOL_MAX_THREADS,
 * BVHD_NO_MEMORY, and BVHD_IO when the system starts no more threads.
 */
enum bvhd_status pool_create(unsigned threads, void (*wake)(void *context), void *wake_context, struct pool **ret_pool,
                             struct bvhd_error *error);

/*
 * Joins all threads, one of which may still be inside `wake`. All jobs must be done and all flows ended. `pool` may be
 * NULL.
 */
void pool_destroy(struct pool *pool);

/* Returns the number of workers, without the spare threads. */
unsigned pool_threads(const struct pool *pool);

/*
 * Creates a flow: for jobs, or as an account around other flows. `within` is NULL, or a flow that has no jobs of its
 * own and is not within another one. Returns NULL without memory.
 */
struct pool_flow *pool_flow_create(struct pool *pool, struct pool_flow *within);

/*
 * Gives the flow up. Its jobs may still be queued or running, and flows within it may exist; it is freed when the last
 * of them is done. `flow` may be NULL.
 */
void pool_flow_end(struct pool *pool, struct pool_flow *flow);

/* What the jobs of one flow have had, and have. */
struct pool_flow_load {
    uint32_t threads; /* that work for it now */
    uint64_t busy_ns; /* as in pool_load, of its jobs and tasks alone */
};

struct pool_flow_load pool_flow_load(struct pool *pool, const struct pool_flow *flow);

/* Queues a job. A job whose done() has been called can be submitted again; its `cancel` keeps its value. */
void pool_submit(struct pool *pool, struct pool_job *job);

/*
 * Sets `cancel`, and withdraws the job if it is queued; its done() is then called by the next pool_collect. The call
 * may be repeated, and is allowed after the job has ended, as long as the job's memory is valid.
 */
void pool_cancel(struct pool *pool, struct pool_job *job);

/*
 * Another client wants the job, too: if its turn in `flow`, with that priority, is earlier than where the job is now,
 * the job goes on there, whether it is queued or running. The time that it has had so far stays with the flow that it
 * leaves. Does nothing if the job has ended.
 */
void pool_favour(struct pool *pool, struct pool_job *job, struct pool_flow *flow, int priority);

/* Works like pool_favour, but moves the job in any case: nobody in its old flow wants it any more. */
void pool_move(struct pool *pool, struct pool_job *job, struct pool_flow *flow, int priority);

/*
 * Calls done() of the jobs that have ended, in the order in which they ended, for at most POOL_COLLECT_MOST jobs.
 * done() is allowed to submit and cancel jobs. Returns whether more jobs have ended; `wake` has then been called again.
 */
bool pool_collect(struct pool *pool);

struct pool_load {
    uint32_t queued, running; /* jobs */
    /*
     * the sum of the time that all threads have spent in jobs and tasks; sleeping until other threads end theirs is not
     * counted
     */
    uint64_t busy_ns;
    uint64_t jobs_done; /* jobs that ran to their end */
    /* wall time with jobs queued or running, with the pauses between them that are shorter than POOL_PAUSE_NS */
    uint64_t active_ns;
};

/* Returns the load now, and the sums since the pool was created. */
struct pool_load pool_load(struct pool *pool);

#endif
