/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/ready_memfds.h"

#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "daemon/system/detached.h"
#include "daemon/system/release.h"
#include "proto/base/bytes.h"
#include "proto/base/clock.h"

#ifndef MADV_POPULATE_WRITE
#define MADV_POPULATE_WRITE 23
#endif

/* Bytes whose pages are made at once, in some 30 us. */
enum { PIECE = 64 * 1024 };

struct ready_memfds {
    struct memory *owner; /* of this struct */
    struct memory memory; /* the budget */
    struct descriptors *descriptors;
    unsigned most_readers, idle_ms;
    pthread_mutex_t lock; /* of the fields below */
    pthread_cond_t changed; /* there may be something to do for the thread */
    pthread_cond_t ended; /* the thread has ended */
    unsigned readers;
    bool has_thread, ends;
    struct memfd ready[READY_MOST]; /* the oldest one first */
    uint64_t wanted[READY_MOST]; /* sizes that are to be prepared */
    uint32_t ready_count, wanted_count;
};

/* ---- what is ready ---- */

/* Rounds up by an eighth at most, so that results of about one size can use each other's memfds. */
static uint64_t rounded(uint64_t size)
{
    if (size > INT64_MAX / 2)
        return UINT64_MAX;
    uint64_t step = READY_SIZE_MIN / 8;
    while (step * 16 <= size)
        step *= 2;
    return bytes_align(size, step);
}

static bool serves(const struct memfd *memfd, uint64_t size)
{
    return memfd->size >= size && memfd->size / 2 < size;
}

static struct memfd remove_ready(struct ready_memfds *ready, uint32_t index)
{
    struct memfd removed = ready->ready[index];
    ready->ready_count--;
    memmove(&ready->ready[index], &ready->ready[index + 1], (ready->ready_count - index) * sizeof removed);
    return removed;
}

/* The memfd counts no longer. */
static void uncount(struct ready_memfds *ready, const struct memfd *memfd)
{
    memory_release(&ready->memory, memfd->size);
    descriptors_give(ready->descriptors, 1);
}

static void give_back(struct ready_memfds *ready, const struct memfd *memfd)
{
    memfd_unmap(memfd);
    release_memfd(memfd->descriptor, memfd->size);
    uncount(ready, memfd);
}

/* Returns the index of the smallest one that serves, or ready_count. */
static uint32_t find(const struct ready_memfds *ready, uint64_t size)
{
    uint32_t best = ready->ready_count;
    for (uint32_t i = 0; i < ready->ready_count; i++)
        if (serves(&ready->ready[i], size) &&
            (best == ready->ready_count || ready->ready[i].size < ready->ready[best].size))
            best = i;
    return best;
}

/* ---- preparing ---- */

/* Gives back the oldest one that does not serve that size. Called with the lock, which it gives up meanwhile. */
static bool give_back_other(struct ready_memfds *ready, uint64_t size)
{
    uint32_t index = 0;
    while (index < ready->ready_count && serves(&ready->ready[index], size))
        index++;
    if (index == ready->ready_count)
        return false;
    struct memfd other = remove_ready(ready, index);
    pthread_mutex_unlock(&ready->lock);
    give_back(ready, &other);
    pthread_mutex_lock(&ready->lock);
    return true;
}

static bool has_room(struct ready_memfds *ready, uint64_t size)
{
    if (ready->ready_count == READY_MOST || !memory_reserve(&ready->memory, size))
        return false;
    if (descriptors_take(ready->descriptors, 1, DESCRIPTORS_RESERVE))
        return true;
    memory_release(&ready->memory, size);
    return false;
}

/*
 * Makes pages and maps them, a piece at a time. No lock of the system is held for long, and others that want the
 * processor get it: without sched_yield they would wait for up to a turn of some milliseconds. The kernels before Linux
 * 5.14 do not map pages ahead, which is then left to the thread that writes them.
 */
static enum bvhd_status make_pages(const struct memfd *memfd)
{
    enum bvhd_status status = BVHD_OK;
    for (uint64_t at = 0, size; status == BVHD_OK && at < memfd->size; at += size) {
        size = memfd->size - at < PIECE ? memfd->size - at : PIECE;
        status = memfd_reserve(memfd->descriptor, at, size, NULL);
        if (status == BVHD_OK)
            madvise(memfd->bytes + at, size, MADV_POPULATE_WRITE);
        sched_yield();
    }
    return status;
}

static enum bvhd_status make(uint64_t size, struct memfd *ret_memfd)
{
    int descriptor;
    enum bvhd_status status = memfd_make(&descriptor, NULL);
    if (status != BVHD_OK)
        return status;
    status = memfd_map(descriptor, size, ret_memfd, NULL);
    if (status == BVHD_OK) {
        status = make_pages(ret_memfd);
        if (status != BVHD_OK)
            memfd_unmap(ret_memfd);
    }
    if (status != BVHD_OK)
        close(descriptor);
    return status;
}

/* Prepares one memfd, if there is room for it. Called with the lock, which it gives up meanwhile. */
static void prepare(struct ready_memfds *ready, uint64_t size)
{
    while (!has_room(ready, size))
        if (!give_back_other(ready, size))
            return;
    pthread_mutex_unlock(&ready->lock);
    struct memfd memfd = {.size = size};
    enum bvhd_status status = make(size, &memfd);
    if (status != BVHD_OK)
        uncount(ready, &memfd);
    pthread_mutex_lock(&ready->lock);
    if (status == BVHD_OK)
        ready->ready[ready->ready_count++] = memfd;
}

/* ---- the thread ---- */

static bool may_prepare(const struct ready_memfds *ready)
{
    return ready->wanted_count > 0 && ready->readers <= ready->most_readers;
}

/* Waits until there is something to do. Returns false when that has not come for a while. */
static bool wait_for_work(struct ready_memfds *ready)
{
    uint64_t until_ns = clock_ns() + ready->idle_ms * UINT64_C(1000000);
    const struct timespec until = {(time_t)(until_ns / 1000000000), (long)(until_ns % 1000000000)};
    while (!ready->ends && !may_prepare(ready))
        if (pthread_cond_timedwait(&ready->changed, &ready->lock, &until) == ETIMEDOUT)
            return false;
    return !ready->ends;
}

/* Called with the lock, which it gives up meanwhile: the loop takes it often, and unmapping takes milliseconds. */
static void give_back_all(struct ready_memfds *ready)
{
    while (ready->ready_count > 0) {
        struct memfd last = ready->ready[--ready->ready_count];
        pthread_mutex_unlock(&ready->lock);
        give_back(ready, &last);
        pthread_mutex_lock(&ready->lock);
    }
}

static void *prepare_until_idle(void *context)
{
    struct ready_memfds *ready = context;
    pthread_mutex_lock(&ready->lock);
    do {
        while (wait_for_work(ready))
            prepare(ready, ready->wanted[--ready->wanted_count]);
        ready->wanted_count = 0;
        give_back_all(ready);
    } while (!ready->ends && may_prepare(ready));
    ready->has_thread = false;
    pthread_cond_broadcast(&ready->ended);
    pthread_mutex_unlock(&ready->lock);
    return NULL;
}

/* Notes that one of that size is to be prepared, when the reader has left. */
static void want(struct ready_memfds *ready, uint64_t size)
{
    if (ready->wanted_count < READY_MOST && size <= ready->memory.limit)
        ready->wanted[ready->wanted_count++] = size;
}

static void start_preparing(struct ready_memfds *ready)
{
    if (ready->has_thread)
        pthread_cond_signal(&ready->changed);
    else
        ready->has_thread = detached_start(prepare_until_idle, ready);
}

/* ---- readers ---- */

void ready_memfds_enter(struct ready_memfds *ready)
{
    pthread_mutex_lock(&ready->lock);
    ready->readers++;
    pthread_mutex_unlock(&ready->lock);
}

void ready_memfds_leave(struct ready_memfds *ready)
{
    pthread_mutex_lock(&ready->lock);
    ready->readers--;
    pthread_mutex_unlock(&ready->lock);
}

void ready_memfds_prepare(struct ready_memfds *ready)
{
    pthread_mutex_lock(&ready->lock);
    if (may_prepare(ready))
        start_preparing(ready);
    pthread_mutex_unlock(&ready->lock);
}

bool ready_memfds_take(struct ready_memfds *ready, uint64_t size, struct memfd *ret_memfd)
{
    if (size < READY_SIZE_MIN)
        return false;
    pthread_mutex_lock(&ready->lock);
    uint32_t index = find(ready, size);
    bool is_found = index < ready->ready_count;
    if (is_found) {
        *ret_memfd = remove_ready(ready, index);
        uncount(ready, ret_memfd);
    }
    want(ready, rounded(size));
    pthread_mutex_unlock(&ready->lock);
    return is_found;
}

struct ready_load ready_memfds_load(struct ready_memfds *ready)
{
    pthread_mutex_lock(&ready->lock);
    struct ready_load load = {
        .count = ready->ready_count,
        .wanted = ready->wanted_count,
        .bytes = atomic_load_explicit(&ready->memory.live, memory_order_relaxed),
    };
    pthread_mutex_unlock(&ready->lock);
    return load;
}

/* ---- life ---- */

enum bvhd_status ready_memfds_create(const struct ready_options *options, struct ready_memfds **ret_ready,
                                     struct bvhd_error *error)
{
    struct ready_memfds *ready = memory_alloc(options->memory, sizeof *ready);
    if (!ready)
        return bvhd_error_no_memory(error, "cache", "no memory for memfds that are ready");
    *ready = (struct ready_memfds){
        .owner = options->memory,
        .descriptors = options->descriptors,
        .most_readers = options->most_readers,
        .idle_ms = options->idle_ms,
    };
    memory_init_within(&ready->memory, options->memory, options->budget);
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_mutex_init(&ready->lock, NULL);
    pthread_cond_init(&ready->changed, &attributes);
    pthread_cond_init(&ready->ended, NULL);
    pthread_condattr_destroy(&attributes);
    *ret_ready = ready;
    return BVHD_OK;
}

void ready_memfds_destroy(struct ready_memfds *ready)
{
    if (!ready)
        return;
    pthread_mutex_lock(&ready->lock);
    ready->ends = true;
    pthread_cond_signal(&ready->changed);
    while (ready->has_thread)
        pthread_cond_wait(&ready->ended, &ready->lock);
    pthread_mutex_unlock(&ready->lock);
    pthread_cond_destroy(&ready->ended);
    pthread_cond_destroy(&ready->changed);
    pthread_mutex_destroy(&ready->lock);
    memory_free(ready->owner, ready);
}
