/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pool.h - the threads of the service, and who gets them next.
 *
 * A job is one call of run() on a worker; what it hands to its struct parallel is shared out to the workers that are
 * free. Between two tasks or jobs a worker chooses its next work:
 *
 * * between clients, to the flow that has had the least time so far (a flow that comes back after a pause starts level
 *   with the others);
 * * within a flow, to the highest priority; of equal ones a running job's open tasks come before a queued job, and
 *   older jobs first.
 *
 * A job that runs keeps the thread that runs it. So that a small job need not wait for a large one, there are a few
 * spare threads beside the workers: one starts a queued job only while every thread that runs is busy for a job at
 * least POOL_SPARE_RATIO times as large, and of size POOL_SPARE_LEAST or more: what ends soon by itself is waited for.
 * The system's scheduler then shares the processors.
 *
 * Everything but run() is called from one thread, the loop; `wake` comes from any.
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
    POOL_SPARE_LEAST = 8192,
    POOL_MAX_THREADS = 1024,
    POOL_PAUSE_NS = 10 * 1000 * 1000,
    POOL_COLLECT_MOST = 64
};

struct pool;
struct pool_flow;

/*
 * Lives in its owner's struct, from pool_submit until done() is called. Zeroed, then filled by the owner down to the
 * line.
 */
struct pool_job {
    /*
     * `parallel` is for run() and its tasks, until run() returns; on any other thread its for_each does all tasks
     * itself.
     */
    void (*run)(struct pool_job *job, const struct parallel *parallel); /* on a worker; looks at `cancel` by itself */
    void (*done)(struct pool_job *job); /* on the loop, from pool_collect; the job is its owner's again */
    struct pool_flow *flow;
    uint64_t size; /* how much there is to do, in primitives or the like; decides about spare threads */
    int priority; /* higher goes first, within a flow */
    atomic_bool cancel; /* set by pool_cancel; for run() to hand on */
    /* the pool's own */
    bool ran; /* for done(): false when it was cancelled while it was queued */
    uint64_t submitted_ns, started_ns, ended_ns; /* CLOCK_MONOTONIC; started and ended only if it ran */
    int state; /* under the pool's lock */
    uint64_t order; /* counts submissions */
    struct pool_job *next, *previous, *child; /* in the flow's queue, then in the list of ended jobs */
};

/*
 * `threads` 0: one for each processor that this process may use. `wake` is called whenever pool_collect has something
 * to do after it had nothing; it may only pass the word on (uv_async_send).
 */
enum bvhd_status pool_create(unsigned threads, void (*wake)(void *context), void *wake_context, struct pool **ret_pool,
                             struct bvhd_error *error);

/* All jobs must be done and all flows ended. Waits for the threads, one of which may still be in `wake`. NULL-safe. */
void pool_destroy(struct pool *pool);

unsigned pool_threads(const struct pool *pool);

/*
 * A client's account with the scheduler: the time that its jobs have had. NULL without memory. It may end while its
 * jobs still wait or run: they keep it until the last is done.
 */
struct pool_flow *pool_flow_create(struct pool *pool);
void pool_flow_end(struct pool *pool, struct pool_flow *flow);

/* A job whose done() has been called may come again; its `cancel` stays as it is. */
void pool_submit(struct pool *pool, struct pool_job *job);

/*
 * Sets the flag. A queued job is withdrawn, and its done() comes with the next pool_collect. Harmless when repeated, or
 * late, as long as the job's memory is there.
 */
void pool_cancel(struct pool *pool, struct pool_job *job);

/*
 * Calls done() of the jobs that have ended, in the order in which they did, of POOL_COLLECT_MOST at most; done() may
 * submit and cancel. Returns whether there are more, for which `wake` has been called again.
 */
bool pool_collect(struct pool *pool);

struct pool_load {
    uint32_t queued, running; /* jobs */
    /* time that threads have spent in jobs and tasks so far, all together; waiting for other threads' tasks is none */
    uint64_t busy_ns;
    uint64_t jobs_done; /* those that ran */
    /* wall time with jobs queued or running; pauses shorter than POOL_PAUSE_NS between them count */
    uint64_t active_ns;
};

struct pool_load pool_load(struct pool *pool);

#endif
