/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/disk_writer.h"

#include <errno.h>
#include <inttypes.h>
#include <pthread.h>
#include <signal.h>
#include <sys/mman.h>
#include <time.h>

#include "builder/content_key.h"
#include "builder/summary.h"
#include "daemon/system/log.h"
#include "proto/base/clock.h"

struct disk_writer {
    struct store *store;
    struct memory *memory;
    uint64_t most_bytes;
    pthread_t thread;
    struct log_limit failures; /* used by the thread only */
    pthread_mutex_t lock; /* of the fields below */
    pthread_cond_t changed; /* something was queued, or the thread is to end */
    pthread_cond_t advanced; /* something has left the queue */
    struct blob *queue[DISK_WRITER_MOST]; /* refs; a ring */
    uint32_t first, count; /* the first one is being written */
    uint64_t bytes, dropped;
    uint64_t taken; /* results that have left the queue so far */
    bool ends;
    uint64_t deadline_ns; /* once it ends: when to drop what is left */
};

/* ---- the store ---- */

static void report(struct disk_writer *writer, const char *what, enum bvhd_status status,
                   const struct bvhd_error *error)
{
    uint32_t suppressed;
    if (status == BVHD_OK || status == BVHD_CANCELLED || !log_limit_pass(&writer->failures, &suppressed))
        return;
    log_event(LOG_WARNING, what, "where=%s why=%s suppressed=%u", log_quote(error->where).text,
              log_quote(error->text).text, suppressed);
}

static void count_entries(struct disk_writer *writer)
{
    struct bvhd_error error;
    uint64_t begin = clock_ns();
    enum bvhd_status status = store_scan(writer->store, &error);
    report(writer, "disk_scan_failed", status, &error);
    if (status != BVHD_OK)
        return;
    struct store_state state = store_state(writer->store);
    log_event(LOG_INFO, "disk_cache", "dir=%s entries=%" PRIu64 " bytes=%" PRIu64 " ms=%.0f",
              log_quote(store_directory(writer->store)).text, state.entries, state.bytes,
              (double)(clock_ns() - begin) * 1e-6);
}

static void trim(struct disk_writer *writer)
{
    struct bvhd_error error;
    if (store_needs_trim(writer->store))
        report(writer, "disk_trim_failed", store_trim(writer->store, &error), &error);
}

static enum bvhd_status put(struct disk_writer *writer, const struct blob *blob, const void *bytes,
                            struct bvhd_error *error)
{
    unsigned char about[SUMMARY_SIZE];
    summary_write(&blob->summary, about);
    const struct store_entry entry = {.key = blob->key, .summary = {about, sizeof about}, .size = blob->size};
    return store_put(writer->store, &entry, bytes, error);
}

/* The bytes of a memfd are mapped for that time. */
static enum bvhd_status put_blob(struct disk_writer *writer, const struct blob *blob, struct bvhd_error *error)
{
    if (blob->descriptor < 0)
        return put(writer, blob, blob->bytes, error);
    void *mapping = mmap(NULL, blob->size, PROT_READ, MAP_PRIVATE, blob->descriptor, 0);
    if (mapping == MAP_FAILED)
        return bvhd_error_set(error, BVHD_NO_MEMORY, "cache", "no address space for a result");
    enum bvhd_status status = put(writer, blob, mapping, error);
    munmap(mapping, blob->size);
    return status;
}

static enum bvhd_status put_record(struct disk_writer *writer, const struct blob *blob, struct bvhd_error *error)
{
    struct store_entry entry = {.size = blob->record.size};
    enum bvhd_status status = content_key_of_record(&blob->key, &entry.key, error);
    return status == BVHD_OK ? store_put(writer->store, &entry, blob->record.data, error) : status;
}

/*
 * The record comes first, so that a result has it wherever it is. A result that exceeds the store's bound for one entry
 * is no failure.
 */
static void write_blob(struct disk_writer *writer, const struct blob *blob)
{
    struct bvhd_error error;
    enum bvhd_status status = blob->record.size > 0 ? put_record(writer, blob, &error) : BVHD_OK;
    if (status == BVHD_OK)
        status = put_blob(writer, blob, &error);
    if (status != BVHD_TOO_LARGE)
        report(writer, "disk_write_failed", status, &error);
}

/* ---- the queue ---- */

static void wait_for_work(struct disk_writer *writer)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += DISK_WRITER_CHECK_SECONDS;
    while (writer->count == 0 && !writer->ends)
        if (pthread_cond_timedwait(&writer->changed, &writer->lock, &until) == ETIMEDOUT)
            break;
}

/* Removes the first result, whose ref the caller drops. */
static struct blob *remove_first(struct disk_writer *writer)
{
    struct blob *blob = writer->queue[writer->first];
    writer->first = (writer->first + 1) % DISK_WRITER_MOST;
    writer->count--;
    writer->bytes -= blob->size;
    writer->taken++;
    pthread_cond_broadcast(&writer->advanced);
    return blob;
}

/* Waits for a result, which stays the first of the queue. NULL: there is none yet. */
static struct blob *await_first(struct disk_writer *writer, bool *ret_ends)
{
    pthread_mutex_lock(&writer->lock);
    wait_for_work(writer);
    struct blob *first = writer->count > 0 ? writer->queue[writer->first] : NULL;
    *ret_ends = writer->ends && (!first || clock_ns() >= writer->deadline_ns);
    pthread_mutex_unlock(&writer->lock);
    return first;
}

static void *write_until_the_end(void *context)
{
    struct disk_writer *writer = context;
    bool ends;
    count_entries(writer);
    for (struct blob *blob = await_first(writer, &ends); !ends; blob = await_first(writer, &ends)) {
        if (blob) {
            write_blob(writer, blob);
            pthread_mutex_lock(&writer->lock);
            remove_first(writer);
            pthread_mutex_unlock(&writer->lock);
            blob_unref(blob);
        }
        trim(writer);
    }
    return NULL;
}

void disk_writer_add(struct disk_writer *writer, struct blob *blob)
{
    pthread_mutex_lock(&writer->lock);
    bool fits = writer->count == 0 || (writer->count < DISK_WRITER_MOST && blob->size <= writer->most_bytes &&
                                       writer->bytes <= writer->most_bytes - blob->size);
    if (fits) {
        writer->queue[(writer->first + writer->count) % DISK_WRITER_MOST] = blob_ref(blob);
        writer->count++;
        writer->bytes += blob->size;
        pthread_cond_signal(&writer->changed);
    }
    writer->dropped += !fits;
    pthread_mutex_unlock(&writer->lock);
}

void disk_writer_flush(struct disk_writer *writer)
{
    pthread_mutex_lock(&writer->lock);
    uint64_t until = writer->taken + writer->count;
    while (writer->taken < until)
        pthread_cond_wait(&writer->advanced, &writer->lock);
    pthread_mutex_unlock(&writer->lock);
}

struct disk_writer_load disk_writer_load(struct disk_writer *writer)
{
    pthread_mutex_lock(&writer->lock);
    struct disk_writer_load load = {.queued = writer->count, .queued_bytes = writer->bytes, .dropped = writer->dropped};
    pthread_mutex_unlock(&writer->lock);
    return load;
}

/* ---- the thread ---- */

static void init_lock(struct disk_writer *writer)
{
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_mutex_init(&writer->lock, NULL);
    pthread_cond_init(&writer->changed, &attributes);
    pthread_cond_init(&writer->advanced, NULL);
    pthread_condattr_destroy(&attributes);
}

static void free_writer(struct disk_writer *writer)
{
    pthread_cond_destroy(&writer->advanced);
    pthread_cond_destroy(&writer->changed);
    pthread_mutex_destroy(&writer->lock);
    memory_free(writer->memory, writer);
}

/* The thread gets no signals: those are for the loop. */
static bool start_thread(struct disk_writer *writer)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int failure = pthread_create(&writer->thread, NULL, write_until_the_end, writer);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return failure == 0;
}

enum bvhd_status disk_writer_create(struct store *store, uint64_t most_bytes, struct memory *memory,
                                    struct disk_writer **ret_writer, struct bvhd_error *error)
{
    struct disk_writer *writer = memory_alloc(memory, sizeof *writer);
    if (!writer)
        return bvhd_error_no_memory(error, "cache", "no memory for the queue of results");
    *writer = (struct disk_writer){.store = store, .memory = memory, .most_bytes = most_bytes};
    init_lock(writer);
    if (!start_thread(writer)) {
        free_writer(writer);
        return bvhd_error_set(error, BVHD_IO, "cache", "no thread could be started");
    }
    *ret_writer = writer;
    return BVHD_OK;
}

void disk_writer_destroy(struct disk_writer *writer, uint64_t patience_ms)
{
    if (!writer)
        return;
    pthread_mutex_lock(&writer->lock);
    writer->ends = true;
    writer->deadline_ns = clock_ns() + patience_ms * 1000000;
    pthread_cond_signal(&writer->changed);
    pthread_mutex_unlock(&writer->lock);
    pthread_join(writer->thread, NULL);
    if (writer->count > 0)
        log_event(LOG_WARNING, "disk_writes_dropped", "results=%u bytes=%" PRIu64, writer->count, writer->bytes);
    while (writer->count > 0)
        blob_unref(remove_first(writer));
    free_writer(writer);
}
