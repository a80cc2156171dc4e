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

enum { CACHE_LINE = 64, CALLS_PER_THREAD = 4 };

/* Bits of a call's state; the others count the helpers: threads that run tasks of the call and are not its caller. */
enum { CALL_TAKEN = 1 << 30, CALL_OPEN = 1 << 29, CALL_HELPERS = CALL_OPEN - 1 };

/*
 * One call of for_each, or room for one. The calls of a pool are used again but not freed before the pool, so that a
 * thread may look for work in a call that ends at the same time. A helper joins by counting itself, and leaves again,
 * without a look at the other fields, if the call then is not open. Fields without a comment do not change from when a
 * call is opened until the helpers that found it open have left.
 */
struct call {
    _Alignas(CACHE_LINE) atomic_uint state;
    parallel_task task;
    void *context;
    size_t count;
    struct workers *workers; /* never changes */
    const struct call *parent; /* the call whose task made this one, if it runs on the same workers; else NULL */
    /* tasks that have not been handed out; below 0 when threads have asked in vain; on a line of its own */
    _Alignas(CACHE_LINE) atomic_llong left;
};

/* The interface that callers hold, and the way from it back to the workers. */
struct face {
    struct parallel parallel;
    struct workers *workers;
};

/* Threads take the lock only to sleep, and to wake others. */
struct workers {
    struct face face;
    struct call *calls;
    unsigned call_count;
    atomic_uint calls_used; /* how many of the first calls have ever been taken */
    /* changes when a call is opened, and at the end; free threads watch it before they sleep; on a line of its own */
    _Alignas(CACHE_LINE) atomic_uint posted;
    /* workers that sleep on `work`, and callers that sleep on `changed`; changed under the lock */
    _Alignas(CACHE_LINE) atomic_uint sleepers;
    atomic_uint waiters;
    atomic_bool stop;
    pthread_mutex_t lock;
    pthread_cond_t work; /* signalled when a call is opened, and when the workers have to stop */
    pthread_cond_t changed; /* signalled when the last helper leaves a call, and when a nested call is opened */
    pthread_cond_t ready; /* signalled when a thread has started */
    unsigned started; /* threads that have started; under the lock */
    /* length of `threads`: one less than face.parallel.threads */
    unsigned thread_count;
    pthread_t threads[];
};

/*
 * A thread spins before it sleeps, since the stages of a build follow each other within microseconds, and a sleep and a
 * wake-up cost ten, on virtual machines up to fifty. It spins for as long as it has worked since it last slept, within
 * these bounds: so the threads of a large build are awake when its next stage begins, and small builds do not keep many
 * threads busy for nothing. A thread that is woken too late to find a task still is there for the next stage.
 */
enum { SPIN_LEAST_NS = 50000, SPIN_MOST_NS = 1000000, SPIN_ROUNDS = 32 };

struct spin {
    uint64_t end; /* by clock_ns */
    unsigned round;
};

/* The innermost call whose task this thread is running. */
static _Thread_local const struct call *current;

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

static const struct call *current_of(const struct workers *workers)
{
    return current && current->workers == workers ? current : NULL;
}

static void run_tasks(struct call *call)
{
    const struct call *outer = current;
    const long long count = (long long)call->count;
    current = call;
    for (;;) {
        long long left = atomic_fetch_sub_explicit(&call->left, 1, memory_order_relaxed);
        if (left <= 0)
            break;
        call->task(call->context, (size_t)(count - left));
    }
    current = outer;
}

static bool descends_from(const struct call *call, const struct call *ancestor)
{
    for (call = call->parent; call; call = call->parent)
        if (call == ancestor)
            return true;
    return false;
}

static bool has_helpers(const struct call *call)
{
    return atomic_load_explicit(&call->state, memory_order_acquire) & CALL_HELPERS;
}

/* Wakes the threads that sleep on a condition after what they check has changed. */
static void wake_all(struct workers *workers, pthread_cond_t *condition)
{
    pthread_mutex_lock(&workers->lock);
    pthread_cond_broadcast(condition);
    pthread_mutex_unlock(&workers->lock);
}

/* The last helper of a closed call wakes its caller. The caller may use the call again at once. */
static void leave(struct workers *workers, struct call *call)
{
    if (atomic_fetch_sub(&call->state, 1) == CALL_TAKEN + 1 && atomic_load(&workers->waiters) > 0)
        wake_all(workers, &workers->changed);
}

/* Becomes a helper of the call if it is open and has tasks left. */
static bool join(struct workers *workers, struct call *call)
{
    if (atomic_load_explicit(&call->left, memory_order_relaxed) <= 0)
        return false;
    if (atomic_fetch_add_explicit(&call->state, 1, memory_order_acquire) & CALL_OPEN)
        return true;
    leave(workers, call);
    return false;
}

/*
 * Runs tasks of one call of other threads; with an ancestor, only of a call that was made by the ancestor's tasks,
 * directly or not. Returns false if there is none.
 */
static bool help(struct workers *workers, const struct call *ancestor)
{
    unsigned used = atomic_load_explicit(&workers->calls_used, memory_order_relaxed);
    for (unsigned i = 0; i < used; i++) {
        struct call *call = &workers->calls[i];
        if (!join(workers, call))
            continue;
        bool suits = !ancestor || descends_from(call, ancestor);
        if (suits)
            run_tasks(call);
        leave(workers, call);
        if (suits)
            return true;
    }
    return false;
}

/* Takes a call for the caller's use. Returns NULL if all are in use. */
static struct call *take_call(struct workers *workers)
{
    for (unsigned i = 0; i < workers->call_count; i++) {
        unsigned none = 0, used = atomic_load_explicit(&workers->calls_used, memory_order_relaxed);
        struct call *call = &workers->calls[i];
        if (atomic_load_explicit(&call->state, memory_order_relaxed) != 0 ||
            !atomic_compare_exchange_strong_explicit(&call->state, &none, CALL_TAKEN, memory_order_acquire,
                                                     memory_order_relaxed))
            continue;
        while (used <= i && !atomic_compare_exchange_weak_explicit(&workers->calls_used, &used, i + 1,
                                                                   memory_order_relaxed, memory_order_relaxed))
            continue;
        return call;
    }
    return NULL;
}

/* Opens a call for helpers, and wakes as many as it has tasks for. */
static void post(struct workers *workers, struct call *call)
{
    const size_t others = call->count - 1;
    const bool is_nested = call->parent;
    atomic_store_explicit(&call->left, (long long)call->count, memory_order_relaxed);
    atomic_fetch_or_explicit(&call->state, CALL_OPEN, memory_order_release);
    atomic_fetch_add(&workers->posted, 1);
    if (is_nested && atomic_load(&workers->waiters) > 0)
        wake_all(workers, &workers->changed);
    if (atomic_load(&workers->sleepers) == 0)
        return;
    pthread_mutex_lock(&workers->lock);
    unsigned sleepers = atomic_load(&workers->sleepers);
    pthread_mutex_unlock(&workers->lock);
    if (sleepers > others)
        for (size_t i = 0; i < others; i++)
            pthread_cond_signal(&workers->work);
    else
        pthread_cond_broadcast(&workers->work);
}

/* Spins until the last helper leaves, or a call is posted, which may be one to help with. Returns false if neither. */
static bool spin_for_helpers(struct workers *workers, struct call *call, unsigned seen, struct spin *spin)
{
    do {
        if (!has_helpers(call) || atomic_load_explicit(&workers->posted, memory_order_relaxed) != seen)
            return true;
    } while (spin_on(spin));
    return false;
}

static void sleep_for_helpers(struct workers *workers, struct call *call, unsigned seen)
{
    pthread_mutex_lock(&workers->lock);
    atomic_fetch_add(&workers->waiters, 1);
    while ((atomic_load(&call->state) & CALL_HELPERS) && atomic_load(&workers->posted) == seen)
        pthread_cond_wait(&workers->changed, &workers->lock);
    atomic_fetch_sub(&workers->waiters, 1);
    pthread_mutex_unlock(&workers->lock);
}

/* Calls of others, which it cannot help with, do not make it spin longer. */
static void wait_for_helpers(struct workers *workers, struct call *call, uint64_t worked_ns)
{
    struct spin spin = spin_after(worked_ns);
    while (has_helpers(call)) {
        unsigned seen = atomic_load_explicit(&workers->posted, memory_order_acquire);
        if (help(workers, call))
            spin = spin_after(worked_ns);
        else if (!spin_for_helpers(workers, call, seen, &spin))
            sleep_for_helpers(workers, call, seen);
    }
}

static void workers_for_each(const struct parallel *self, size_t count, parallel_task task, void *context)
{
    struct workers *workers = ((const struct face *)self)->workers;
    struct call *call = count > 1 && workers->thread_count > 0 ? take_call(workers) : NULL;
    if (!call) {
        parallel_serial.for_each(&parallel_serial, count, task, context);
        return;
    }
    call->task = task;
    call->context = context;
    call->count = count;
    call->parent = current_of(workers);
    post(workers, call);
    uint64_t begin = clock_ns();
    run_tasks(call);
    atomic_fetch_and(&call->state, ~(unsigned)CALL_OPEN);
    wait_for_helpers(workers, call, clock_ns() - begin);
    atomic_fetch_and_explicit(&call->state, ~(unsigned)CALL_TAKEN, memory_order_release);
}

/* Spins until a call is posted. Returns false if none was. */
static bool spin_for_post(struct workers *workers, unsigned seen, uint64_t worked_ns)
{
    struct spin spin = spin_after(worked_ns);
    do {
        if (atomic_load_explicit(&workers->posted, memory_order_relaxed) != seen)
            return true;
    } while (spin_on(&spin));
    return false;
}

static void sleep_for_post(struct workers *workers, unsigned seen)
{
    pthread_mutex_lock(&workers->lock);
    atomic_fetch_add(&workers->sleepers, 1);
    while (atomic_load(&workers->posted) == seen)
        pthread_cond_wait(&workers->work, &workers->lock);
    atomic_fetch_sub(&workers->sleepers, 1);
    pthread_mutex_unlock(&workers->lock);
}

static void note_start(struct workers *workers)
{
    pthread_mutex_lock(&workers->lock);
    workers->started++;
    pthread_cond_signal(&workers->ready);
    pthread_mutex_unlock(&workers->lock);
}

static void *work_until_stopped(void *argument)
{
    struct workers *workers = argument;
    uint64_t worked_ns = 0; /* since it last slept */
    note_start(workers);
    for (;;) {
        unsigned seen = atomic_load_explicit(&workers->posted, memory_order_acquire);
        uint64_t begin = clock_ns();
        if (atomic_load_explicit(&workers->stop, memory_order_relaxed))
            return NULL;
        if (help(workers, NULL)) {
            worked_ns += clock_ns() - begin;
        } else if (!spin_for_post(workers, seen, worked_ns)) {
            sleep_for_post(workers, seen);
            worked_ns = 0;
        }
    }
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

/* Returns zeroed memory that begins a cache line, or NULL. */
static void *allocate(size_t size)
{
    void *memory;
    if (posix_memalign(&memory, CACHE_LINE, size) != 0)
        return NULL;
    return memset(memory, 0, size);
}

/* Returns a pool without threads, or NULL. */
static struct workers *create_empty(unsigned threads)
{
    struct workers *workers = allocate(sizeof *workers + (threads - 1) * sizeof workers->threads[0]);
    if (!workers)
        return NULL;
    workers->face = (struct face){{.threads = threads, .for_each = workers_for_each}, workers};
    workers->call_count = CALLS_PER_THREAD * threads;
    workers->calls = allocate(workers->call_count * sizeof *workers->calls);
    if (!workers->calls) {
        free(workers);
        return NULL;
    }
    for (unsigned i = 0; i < workers->call_count; i++)
        workers->calls[i].workers = workers;
    pthread_mutex_init(&workers->lock, NULL);
    pthread_cond_init(&workers->work, NULL);
    pthread_cond_init(&workers->changed, NULL);
    pthread_cond_init(&workers->ready, NULL);
    return workers;
}

enum bvhd_status workers_create(unsigned threads, struct workers **ret_workers, struct bvhd_error *error)
{
    if (threads > WORKERS_MAX_THREADS)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "threads", "%u threads are more than %d", threads,
                              WORKERS_MAX_THREADS);
    if (threads == 0)
        threads = processor_count() < WORKERS_MAX_THREADS ? processor_count() : WORKERS_MAX_THREADS;
    struct workers *workers = create_empty(threads);
    if (!workers)
        return bvhd_error_no_memory(error, "threads", "no memory for %u threads", threads);
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
    atomic_store(&workers->stop, true);
    atomic_fetch_add(&workers->posted, 1); /* ends the spinning */
    wake_all(workers, &workers->work);
    for (unsigned i = 0; i < workers->thread_count; i++)
        pthread_join(workers->threads[i], NULL);
    pthread_cond_destroy(&workers->ready);
    pthread_cond_destroy(&workers->changed);
    pthread_cond_destroy(&workers->work);
    pthread_mutex_destroy(&workers->lock);
    free(workers->calls);
    free(workers);
}

const struct parallel *workers_parallel(const struct workers *workers)
{
    return &workers->face.parallel;
}
