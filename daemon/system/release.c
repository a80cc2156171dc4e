/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/release.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "daemon/system/detached.h"
#include "proto/base/clock.h"

/* A queued call of munmap or close. */
struct release {
    struct release *next;
    void *address; /* NULL for a descriptor */
    uint64_t size;
    int descriptor;
    struct descriptor_share *share; /* NULL: the descriptor is charged to nobody */
};

/* Queued calls in their order. */
struct release_list {
    struct release *first, *last;
};

/* A list that threads work on. They end when it has been empty for idle_ms. */
struct release_queue {
    pthread_mutex_t mutex;
    pthread_cond_t filled;
    struct release_list list;
    unsigned threads, most_threads;
    unsigned waiting; /* threads that wait for an entry */
    unsigned idle_ms; /* how long they wait */
};

/*
 * Both are global, because mappings and descriptors belong to the process. `own` is for mappings and memfds, which take
 * a while to release but come to an end; its thread waits for more, because starting one takes longer than waking it.
 * `foreign` is for other descriptors of clients: close() of one of these may never return, so it must not be queued
 * ahead of the former.
 */
static struct release_queue own = {
    .mutex = PTHREAD_MUTEX_INITIALIZER, .filled = PTHREAD_COND_INITIALIZER, .most_threads = 1, .idle_ms = 500};
static struct release_queue foreign = {
    .mutex = PTHREAD_MUTEX_INITIALIZER, .filled = PTHREAD_COND_INITIALIZER, .most_threads = RELEASE_FOREIGN_THREADS};

/* Each thread has its own: whether it calls release_flush, and the releases that wait for its next call. */
static _Thread_local bool is_flushing;
static _Thread_local struct release_list unflushed;

/* Entries for times without memory, so that descriptors are closed then, too. The free ones are in a list. */
enum { SPARES = 256 };
static struct release spares[SPARES];
static struct release *free_spare;
static unsigned used_spares; /* that were in use at any time */
static pthread_mutex_t spares_mutex = PTHREAD_MUTEX_INITIALIZER;

static struct release *take_spare(void)
{
    pthread_mutex_lock(&spares_mutex);
    struct release *spare = free_spare;
    if (spare)
        free_spare = spare->next;
    else if (used_spares < SPARES)
        spare = &spares[used_spares++];
    pthread_mutex_unlock(&spares_mutex);
    return spare;
}

static void free_entry(struct release *release)
{
    uintptr_t at = (uintptr_t)release;
    if (at < (uintptr_t)spares || at >= (uintptr_t)(spares + SPARES)) {
        free(release);
        return;
    }
    pthread_mutex_lock(&spares_mutex);
    release->next = free_spare;
    free_spare = release;
    pthread_mutex_unlock(&spares_mutex);
}

static void carry_out(const struct release *release)
{
    if (release->address) {
        int result = munmap(release->address, release->size);
        assert(result == 0);
        (void)result;
    } else {
        close(release->descriptor);
        descriptor_share_lingered(release->share);
    }
}

static void append(struct release_list *list, struct release_list *more)
{
    if (list->first)
        list->last->next = more->first;
    else
        list->first = more->first;
    list->last = more->last;
}

/* Waits a while for an entry. Called with the mutex. */
static void await_entry(struct release_queue *queue)
{
    uint64_t until_ns = clock_ns() + queue->idle_ms * UINT64_C(1000000);
    const struct timespec until = {(time_t)(until_ns / 1000000000), (long)(until_ns % 1000000000)};
    queue->waiting++;
    while (!queue->list.first)
        if (pthread_cond_clockwait(&queue->filled, &queue->mutex, CLOCK_MONOTONIC, &until) == ETIMEDOUT)
            break;
    queue->waiting--;
}

/* Returns NULL when the queue stays empty; the calling thread is then no longer counted, and has to end. */
static struct release *take_first(struct release_queue *queue)
{
    pthread_mutex_lock(&queue->mutex);
    if (!queue->list.first && queue->idle_ms > 0)
        await_entry(queue);
    struct release *release = queue->list.first;
    if (release)
        queue->list.first = release->next;
    else
        queue->threads--;
    pthread_mutex_unlock(&queue->mutex);
    return release;
}

static void *work(void *context)
{
    struct release_queue *queue = context;
    for (struct release *release; (release = take_first(queue));) {
        carry_out(release);
        free_entry(release);
    }
    return NULL;
}

/*
 * Queues what is on the list. When no thread can be started, the entries stay in the queue until a running thread of
 * this queue, or one that a later call starts, takes them.
 */
static void queue_all(struct release_queue *queue, struct release_list *list)
{
    pthread_mutex_lock(&queue->mutex);
    append(&queue->list, list);
    bool is_awaited = queue->waiting > 0, more = !is_awaited && queue->threads < queue->most_threads;
    queue->threads += more;
    pthread_mutex_unlock(&queue->mutex);
    if (is_awaited)
        pthread_cond_signal(&queue->filled);
    if (more && !detached_start(work, queue)) {
        pthread_mutex_lock(&queue->mutex);
        queue->threads--;
        pthread_mutex_unlock(&queue->mutex);
    }
}

/* Queues a copy of `release`. Returns false when there is neither memory nor a spare entry for it. */
static bool hand_over(struct release_queue *queue, const struct release *release)
{
    struct release *queued = malloc(sizeof *queued);
    if (!queued)
        queued = take_spare();
    if (!queued)
        return false;
    *queued = *release;
    struct release_list list = {queued, queued};
    if (is_flushing && queue == &own)
        append(&unflushed, &list);
    else
        queue_all(queue, &list);
    return true;
}

void release_flush(void)
{
    is_flushing = true;
    if (unflushed.first)
        queue_all(&own, &unflushed);
    unflushed = (struct release_list){NULL, NULL};
}

static void release_own(const struct release *release)
{
    if (release->size < RELEASE_LATER_MIN || !hand_over(&own, release))
        carry_out(release);
}

void release_mapping(void *address, uint64_t size)
{
    release_own(&(struct release){.address = address, .size = size});
}

void release_memfd(int descriptor, uint64_t size)
{
    descriptor_share_linger(NULL);
    release_own(&(struct release){.descriptor = descriptor, .size = size});
}

/*
 * Neither call can block: F_GET_SEALS is answered by the kernel alone, whatever file system the file belongs to, and so
 * is fstat of a file that has seals.
 */
static bool is_memfd(int descriptor, uint64_t *ret_size)
{
    struct stat file;
    if (fcntl(descriptor, F_GET_SEALS) < 0 || fstat(descriptor, &file) != 0)
        return false;
    *ret_size = (uint64_t)file.st_blocks * 512; /* its pages, which may be more or less than st_size */
    return true;
}

static void give_back(struct descriptor_share *share)
{
    if (share)
        descriptor_share_give(share, 1);
}

void release_descriptor(struct descriptor_share *share, int descriptor)
{
    uint64_t size;
    if (is_memfd(descriptor, &size)) {
        release_memfd(descriptor, size);
        give_back(share);
    } else if (fcntl(descriptor, F_GETFD) >= 0) {
        descriptor_share_linger(share);
        /* When all spare entries are in use, too, it stays open, and counted. */
        hand_over(&foreign, &(struct release){.descriptor = descriptor, .share = share});
    } else {
        give_back(share);
    }
}
