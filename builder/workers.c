/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/workers.h"

#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "proto/base/clock.h"
#include "proto/base/processor.h"

/*
 * One call of for_each; it lives on its caller's stack. Fields without a comment do not change after the call is
 * posted.
 */
struct for_each_call {
    parallel_task task;
    void *context;
    size_t count;
    struct workers *workers;
    struct for_each_call *parent; /* the call whose task made this one, if it runs on the same workers; else NULL */
    atomic_size_t next; /* first task that has not been handed out; may exceed `count` */
    atomic_uint helpers; /* workers that run tasks of this call; changed under the lock */
    struct for_each_call *after; /* next in the list of open calls; under the lock */
    bool waiting; /* the caller sleeps on `changed`; under the lock */
    /* signalled when the last helper leaves, and when a task of this call posts a nested call */
    pthread_cond_t changed;
};

/* The interface that callers hold, and the way from it back to the workers. */
struct face {
    struct parallel parallel;
    struct workers *workers;
};

struct workers {
    struct face face;
    pthread_mutex_t lock;
    pthread_cond_t work; /* signalled when a call is posted, and when the workers have to stop */
    pthread_cond_t ready; /* signalled when a thread has started */
    unsigned started; /* threads that have started; under the lock */
    struct for_each_call *oldest; /* open calls in the order in which they were posted; under the lock */
    unsigned sleepers; /* workers that wait on `work`; under the lock */
    bool stop; /* under the lock */
    /* changes when a call is posted, and at the end; free workers watch it before they sleep; changed under the lock */
    atomic_uint posted;
    /* length of `threads`: one less than face.parallel.threads */
    unsigned thread_count;
    pthread_t threads[];
};

/*
 * A thread spins before it sleeps, since the stages of a build follow each other within microseconds, and a sleep and a
 * wake-up cost about ten. It spins for as long as it has worked since it last slept, within these bounds: so the
 * threads of a large build are awake when its next stage begins, and small builds do not keep many threads busy for
 * nothing.
 */
enum { SPIN_LEAST_NS = 10000, SPIN_MOST_NS = 1000000, SPIN_ROUNDS = 32 };

struct spin {
    uint64_t end; /* by clock_ns */
    unsigned round;
};

/* The innermost call whose task this thread is running. */
static _Thread_local struct for_each_call *current;

static struct spin spin_after(uint64_t worked_ns)
{
    uint64_t ns = worked_ns < SPIN_LEAST_NS ? SPIN_LEAST_NS : worked_ns > SPIN_MOST_NS ? SPIN_MOST_NS : worked_ns;
    return (struct spin){.end = clock_ns() + ns};
}

/*
 * Waits for a few cycles. Returns false when the time is over. Once in SPIN_ROUNDS rounds it looks at the clock, and
 * gives way to a thread that has no processor, since that may be the one it waits for.
 */
static bool spin_on(struct spin *spin)
{
    processor_relax();
    if (++spin->round % SPIN_ROUNDS != 0)
        return true;
    sched_yield();
    return clock_ns() < spin->end;
}

static void run_tasks(struct for_each_call *call)
{
    struct for_each_call *outer = current;
    current = call;
    for (;;) {
        size_t index = atomic_fetch_add_explicit(&call->next, 1, memory_order_relaxed);
        if (index >= call->count)
            break;
        call->task(call->context, index);
    }
    current = outer;
}

static bool descends_from(const struct for_each_call *call, const struct for_each_call *ancestor)
{
    for (call = call->parent; call; call = call->parent)
        if (call == ancestor)
            return true;
    return false;
}

/*
 * Returns the oldest open call with tasks left; with an ancestor, only a call that was made by the ancestor's tasks,
 * directly or not. The lock is held.
 */
static struct for_each_call *find_work(struct workers *workers, const struct for_each_call *ancestor)
{
    for (struct for_each_call *call = workers->oldest; call; call = call->after)
        if (atomic_load_explicit(&call->next, memory_order_relaxed) < call->count &&
            (!ancestor || descends_from(call, ancestor)))
            return call;
    return NULL;
}

/* Runs tasks of another thread's call. The lock is held on entry and on return, but not while tasks run. */
static void help(struct workers *workers, struct for_each_call *call)
{
    atomic_fetch_add_explicit(&call->helpers, 1, memory_order_relaxed);
    pthread_mutex_unlock(&workers->lock);
    run_tasks(call);
    pthread_mutex_lock(&workers->lock);
    if (atomic_fetch_sub_explicit(&call->helpers, 1, memory_order_release) == 1 && call->waiting)
        pthread_cond_signal(&call->changed);
}

static void post(struct workers *workers, struct for_each_call *call)
{
    pthread_mutex_lock(&workers->lock);
    struct for_each_call **end = &workers->oldest;
    while (*end)
        end = &(*end)->after;
    *end = call;
    atomic_fetch_add_explicit(&workers->posted, 1, memory_order_relaxed);
    for (struct for_each_call *ancestor = call->parent; ancestor; ancestor = ancestor->parent)
        if (ancestor->waiting)
            pthread_cond_signal(&ancestor->changed);
    unsigned sleepers = workers->sleepers;
    pthread_mutex_unlock(&workers->lock);

    if (sleepers >= call->count)
        for (size_t i = 1; i < call->count; i++)
            pthread_cond_signal(&workers->work);
    else if (sleepers > 0)
        pthread_cond_broadcast(&workers->work);
}

/* Closes the call: no helper can join it from here on. */
static void withdraw(struct workers *workers, struct for_each_call *call)
{
    pthread_mutex_lock(&workers->lock);
    struct for_each_call **link = &workers->oldest;
    while (*link != call)
        link = &(*link)->after;
    *link = call->after;
    pthread_mutex_unlock(&workers->lock);
}

/* Spins until the last helper leaves, or a call is posted, which may be one to help with. */
static void spin_for_helpers(const struct workers *workers, const struct for_each_call *call, uint64_t worked_ns)
{
    unsigned seen = atomic_load_explicit(&workers->posted, memory_order_relaxed);
    struct spin spin = spin_after(worked_ns);
    while (atomic_load_explicit(&call->helpers, memory_order_relaxed) > 0 &&
           atomic_load_explicit(&workers->posted, memory_order_relaxed) == seen && spin_on(&spin))
        continue;
}

static void wait_for_helpers(struct workers *workers, struct for_each_call *call, uint64_t worked_ns)
{
    spin_for_helpers(workers, call, worked_ns);
    pthread_mutex_lock(&workers->lock);
    while (atomic_load_explicit(&call->helpers, memory_order_acquire) > 0) {
        struct for_each_call *below = find_work(workers, call);
        if (below) {
            help(workers, below);
        } else {
            call->waiting = true;
            pthread_cond_wait(&call->changed, &workers->lock);
            call->waiting = false;
        }
    }
    pthread_mutex_unlock(&workers->lock);
}

static void workers_for_each(const struct parallel *self, size_t count, parallel_task task, void *context)
{
    struct workers *workers = ((const struct face *)self)->workers;
    if (count <= 1 || workers->thread_count == 0) {
        parallel_serial.for_each(&parallel_serial, count, task, context);
        return;
    }
    struct for_each_call call = {
        .task = task,
        .context = context,
        .count = count,
        .workers = workers,
        .parent = current && current->workers == workers ? current : NULL,
        .changed = PTHREAD_COND_INITIALIZER,
    };
    post(workers, &call);
    uint64_t begin = clock_ns();
    run_tasks(&call);
    withdraw(workers, &call);
    wait_for_helpers(workers, &call, clock_ns() - begin);
    pthread_cond_destroy(&call.changed);
}

/* Spins, without the lock, until a call is posted or the time is over. */
static void await_post(struct workers *workers, unsigned seen, uint64_t worked_ns)
{
    struct spin spin = spin_after(worked_ns);
    while (atomic_load_explicit(&workers->posted, memory_order_relaxed) == seen && spin_on(&spin))
        continue;
}

static void *work_until_stopped(void *argument)
{
    struct workers *workers = argument;
    uint64_t worked_ns = 0; /* since it last slept */
    pthread_mutex_lock(&workers->lock);
    workers->started++;
    pthread_cond_signal(&workers->ready);
    while (!workers->stop) {
        struct for_each_call *call = find_work(workers, NULL);
        if (call) {
            uint64_t begin = clock_ns();
            help(workers, call);
            worked_ns += clock_ns() - begin;
            continue;
        }
        unsigned seen = atomic_load_explicit(&workers->posted, memory_order_relaxed);
        pthread_mutex_unlock(&workers->lock);
        await_post(workers, seen, worked_ns);
        pthread_mutex_lock(&workers->lock);
        if (atomic_load_explicit(&workers->posted, memory_order_relaxed) == seen && !workers->stop) {
            workers->sleepers++;
            pthread_cond_wait(&workers->work, &workers->lock);
            workers->sleepers--;
            worked_ns = 0;
        }
    }
    pthread_mutex_unlock(&workers->lock);
    return NULL;
}

/*
 * Returns 0 or an errno value. All signals are blocked while threads start, so that the program's own threads receive
 * them.
 */
static int start_threads(struct workers *workers, unsigned count)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int failure = 0;
    while (!failure && workers->thread_count < count) {
        failure = pthread_create(&workers->threads[workers->thread_count], NULL, work_until_stopped, workers);
        workers->thread_count += failure == 0;
    }
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return failure;
}

/*
 * Waits until every thread is running: one that is still starting may hold locks of the allocator, and a fork would
 * copy those locked for ever.
 */
static void await_start(struct workers *workers)
{
    pthread_mutex_lock(&workers->lock);
    while (workers->started < workers->thread_count)
        pthread_cond_wait(&workers->ready, &workers->lock);
    pthread_mutex_unlock(&workers->lock);
}

enum bvhd_status workers_create(unsigned threads, struct workers **ret_workers, struct bvhd_error *error)
{
    if (threads > WORKERS_MAX_THREADS)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "threads", "%u threads are more than %d", threads,
                              WORKERS_MAX_THREADS);
    if (threads == 0)
        threads = processor_count() < WORKERS_MAX_THREADS ? processor_count() : WORKERS_MAX_THREADS;
    struct workers *workers = calloc(1, sizeof *workers + (threads - 1) * sizeof workers->threads[0]);
    if (!workers)
        return bvhd_error_no_memory(error, "threads", "no memory for %u threads", threads);
    workers->face = (struct face){{.threads = threads, .for_each = workers_for_each}, workers};
    pthread_mutex_init(&workers->lock, NULL);
    pthread_cond_init(&workers->work, NULL);
    pthread_cond_init(&workers->ready, NULL);
    int failure = start_threads(workers, threads - 1);
    if (failure) {
        workers_destroy(workers);
        return bvhd_error_set(error, BVHD_IO, "threads", "cannot start %u threads: %s", threads, strerror(failure));
    }
    await_start(workers);
    *ret_workers = workers;
    return BVHD_OK;
}

void workers_destroy(struct workers *workers)
{
    if (!workers)
        return;
    pthread_mutex_lock(&workers->lock);
    workers->stop = true;
    atomic_fetch_add_explicit(&workers->posted, 1, memory_order_relaxed); /* ends the spinning */
    pthread_mutex_unlock(&workers->lock);
    pthread_cond_broadcast(&workers->work);
    for (unsigned i = 0; i < workers->thread_count; i++)
        pthread_join(workers->threads[i], NULL);
    pthread_cond_destroy(&workers->ready);
    pthread_cond_destroy(&workers->work);
    pthread_mutex_destroy(&workers->lock);
    free(workers);
}

const struct parallel *workers_parallel(const struct workers *workers)
{
    return &workers->face.parallel;
}
