/* SPDX-License-Identifier: Apache-2.0 */
/* pool_steps.h - jobs for tests of the pool, and an event loop that collects them. */
#ifndef BVHD_POOL_STEPS_H
#define BVHD_POOL_STEPS_H

#include "tests/support/unit.h"

#include <pthread.h>
#include <semaphore.h>

#include "daemon/pool/pool.h"

/* The event loop of these tests. It sleeps until the pool wakes it. */
struct loop {
    struct pool *pool;
    pthread_mutex_t lock;
    pthread_cond_t woken;
    unsigned wakes, seen; /* wake-ups so far, and how many of them loop_once has handled */
    pthread_t thread;
};

/* A job with a body that its test sets. `log` records jobs in the order in which they start. */
struct step {
    struct pool_job job;
    struct loop *loop;
    void (*body)(struct step *step, const struct parallel *parallel);
    uint64_t burn_ns; /* how long run() also keeps its thread busy; 0: not at all */
    struct log *log; /* where the step is recorded when it starts; may be NULL */
    sem_t started, may_end;
    bool cancelled_inside; /* whether the job was cancelled at the end of run() */
    unsigned done; /* how often done() was called */
    struct step *to_submit, *to_cancel; /* done() submits or cancels these */
    struct pool_flow *to_end; /* done() ends this flow */
    pthread_t runner; /* the thread that ran run() */
    atomic_uint tasks; /* number of tasks that have started */
    atomic_bool helped; /* some of them ran on another thread than run() */
    size_t count; /* for the test's own use, like `other` */
    struct step *other;
};

enum { LOG_SIZE = 2000 };

/* The steps that have started, in this order. */
struct log {
    atomic_uint count;
    struct step *steps[LOG_SIZE];
};

uint64_t steps_now_ns(void);
void steps_sleep_ms(long milliseconds);

/* Keeps the thread busy for this time by the clock. */
void steps_burn(uint64_t nanoseconds);

/* Like sem_wait, but continues after interruptions. */
void steps_wait(sem_t *semaphore);

void loop_init(struct loop *loop, unsigned threads);
void loop_finish(struct loop *loop);
/* Returns the number of wake-ups so far. */
unsigned loop_wakes(struct loop *loop);

/* Waits for a wake-up that has not been handled yet, and collects. The test fails after a minute. */
void loop_once(struct loop *loop);
/* Creates a flow of the pool; the caller ends it. */
struct pool_flow *loop_flow(struct loop *loop);

void step_init(struct step *step, struct loop *loop, struct pool_flow *flow, uint64_t size);
void step_submit(struct step *step);
void step_await(struct loop *loop, const struct step *step);

/* The done() of every step, unless the test sets another one that calls this. */
void step_done(struct pool_job *job);

/* Whether the step has started. It can be true only until step_wait takes `started`. */
bool step_has_started(struct step *step);

/* Initialises and submits a step that occupies a thread until step_let_go, and waits until it does. */
void step_hold_thread(struct step *step, struct loop *loop, struct pool_flow *flow, uint64_t size);
void step_let_go(struct step *step);

/* A body: `count` tasks of half a millisecond in one for_each; tasks return at once when the job is cancelled. */
void step_many_tasks(struct step *step, const struct parallel *parallel);

#endif
