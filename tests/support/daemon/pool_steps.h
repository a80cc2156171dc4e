/* SPDX-License-Identifier: Apache-2.0 */
/* pool_steps.h - jobs that do what a test of the pool wants, and a loop that they are done on. */
#ifndef BVHD_POOL_STEPS_H
#define BVHD_POOL_STEPS_H

#include "tests/support/unit.h"

#include <pthread.h>
#include <semaphore.h>

#include "daemon/pool/pool.h"

/* The loop of these tests: sleeps until the pool has something for it. */
struct loop {
    struct pool *pool;
    pthread_mutex_t lock;
    pthread_cond_t woken;
    unsigned wakes, seen;
    pthread_t thread;
};

/* A job that does what its test wants. `log` takes jobs in the order in which they start. */
struct step {
    struct pool_job job;
    struct loop *loop;
    void (*body)(struct step *step, const struct parallel *parallel);
    uint64_t burn_ns;
    struct log *log;
    sem_t started, may_end;
    bool cancelled_inside; /* what run() saw at its end */
    unsigned done;
    struct step *to_submit, *to_cancel; /* by done() */
    struct pool_flow *to_end;
    pthread_t runner;
    atomic_uint tasks; /* that have begun */
    atomic_bool helped; /* some of them on another thread than run() */
    size_t count; /* for the test's own use, as are these */
    struct step *other;
};

enum { LOG_SIZE = 2000 };

struct log {
    atomic_uint count;
    struct step *steps[LOG_SIZE];
};

uint64_t steps_now_ns(void);
void steps_sleep_ms(long milliseconds);

/* Keeps the thread busy by the clock. */
void steps_burn(uint64_t nanoseconds);

/* sem_wait that is not interrupted. */
void steps_wait(sem_t *semaphore);

void loop_init(struct loop *loop, unsigned threads);
void loop_finish(struct loop *loop);
unsigned loop_wakes(struct loop *loop);

/* Waits for a wake that has not been seen, and collects; the test fails after a minute. */
void loop_once(struct loop *loop);
struct pool_flow *loop_flow(struct loop *loop);

void step_init(struct step *step, struct loop *loop, struct pool_flow *flow, uint64_t size);
void step_submit(struct step *step);
void step_await(struct loop *loop, const struct step *step);

/* done() of every step, unless the test sets another that calls this. */
void step_done(struct pool_job *job);

/* Until somebody waits for `started`. */
bool step_has_started(struct step *step);

/* Inits and submits one that takes a thread until it is let go, and waits until it does. */
void step_hold_thread(struct step *step, struct loop *loop, struct pool_flow *flow, uint64_t size);
void step_let_go(struct step *step);

/* A body: `count` tasks of half a millisecond in one for_each, of none when the job is cancelled. */
void step_many_tasks(struct step *step, const struct parallel *parallel);

#endif
