/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/flight.h"

#include <assert.h>
#include <stddef.h>

#include "builder/build.h"
#include "daemon/system/log.h"
#include "builder/input/prepare.h"

/*
 * WAITING for memory -> BUILDING on a worker -> landed, or back to WAITING to be alone. ABANDONED: nobody waits any
 * more, and the worker has been told to stop.
 */
enum flight_state { FLIGHT_WAITING, FLIGHT_BUILDING, FLIGHT_ABANDONED };

struct flight {
    struct flights *flights;
    struct flight *next; /* in its bucket */
    enum flight_state state;
    struct preparation *preparation;
    struct flight_waiter *first, *last;
    struct fair_entry entry; /* while WAITING */
    uint64_t bytes; /* what the build may take */
    bool exclusive; /* it is tried again, alone */
    uint64_t started; /* flights->started when it did */
    bool accompanied; /* other builds ran then */
    struct pool_job job;
    /* the worker's answer */
    enum bvhd_status status;
    struct bvhd_error error;
    struct blob *blob;
};

/* What frees a large copy. */
struct disposal {
    struct pool_job job;
    struct flights *flights;
    struct preparation *preparation;
    uint64_t promised;
    enum admission_class class;
};

enum { DISPOSED_AT_ONCE = 1024 * 1024 };

enum bvhd_status flights_init(struct flights *flights, uint32_t most, struct bvhd_error *error)
{
    uint64_t size = 16;
    while (size < most)
        size *= 2;
    flights->buckets = memory_array(flights->memory, size, sizeof *flights->buckets);
    if (!flights->buckets)
        return bvhd_error_set(error, BVHD_NO_MEMORY, "", "no memory for a table of %u builds", most);
    memset(flights->buckets, 0, size * sizeof *flights->buckets);
    flights->mask = size - 1;
    memset(flights->waiting, 0, sizeof flights->waiting);
    flights->running = flights->disposals = 0;
    flights->started = 0;
    return BVHD_OK;
}

uint32_t flights_waiting(const struct flights *flights)
{
    return flights->waiting[ADMISSION_SMALL].count + flights->waiting[ADMISSION_LARGE].count;
}

void flights_finish(struct flights *flights)
{
    assert(flights->running == 0 && flights->disposals == 0 && flights_waiting(flights) == 0);
    memory_free(flights->memory, flights->buckets);
    flights->buckets = NULL;
}

/* Keys are cryptographic hashes: any of their bytes spread. */
static struct flight **bucket_of(const struct flights *flights, const struct key *key)
{
    return &flights->buckets[bytes_get64(key->bytes) & flights->mask];
}

struct flight *flights_find(const struct flights *flights, const struct key *key)
{
    struct flight *flight = *bucket_of(flights, key);
    while (flight && !key_equal(&flight->preparation->key, key))
        flight = flight->next;
    return flight;
}

static void leave_table(struct flight *flight)
{
    struct flight **at = bucket_of(flight->flights, &flight->preparation->key);
    while (*at != flight)
        at = &(*at)->next;
    *at = flight->next;
}

uint64_t flights_build_bytes(const struct preparation *preparation)
{
    /*
     * Peaks for a primitive, vertices apart, with so many threads that all pieces are built at once: a ref and its
     * scratch, 64 bytes, and what their trees take beside them: of clusters (cluster_tree.h) up to 177, when ploc.h
     * gives up at once and binned.h takes over; with quality high 1.4 refs a primitive, each of which takes 180 more
     * during reinsertion; top levels are never split.
     */
    enum { CLUSTERS = 248, HIGH = 344, VERTEX = 12, FIXED = 16 * 1024 };
    const struct canonical *canonical = &preparation->canonical;
    const uint64_t each = preparation->options.quality == QUALITY_HIGH ? HIGH : CLUSTERS;
    return canonical->primitive_count * each + (uint64_t)canonical->vertex_count * VERTEX + FIXED;
}

static void dispose_run(struct pool_job *job, const struct parallel *parallel)
{
    struct disposal *disposal = (void *)job;
    (void)parallel;
    preparation_destroy(disposal->preparation);
}

static void dispose_done(struct pool_job *job)
{
    struct disposal *disposal = (void *)job;
    struct flights *flights = disposal->flights;
    flights->disposals--;
    admission_end(&flights->admission->prepares[disposal->class], disposal->promised);
    memory_free(flights->memory, disposal);
}

void flights_dispose(struct flights *flights, struct preparation *preparation)
{
    struct disposal *disposal = NULL;
    if (!preparation)
        return;
    if (preparation->canonical.size > DISPOSED_AT_ONCE)
        disposal = memory_alloc(flights->memory, sizeof *disposal);
    if (!disposal) {
        admission_end(&flights->admission->prepares[preparation->class], preparation->promised);
        preparation_destroy(preparation);
        return;
    }
    *disposal =
        (struct disposal){.job = {.run = dispose_run, .done = dispose_done, .flow = flights->housekeeping, .size = 1},
                          .flights = flights,
                          .preparation = preparation,
                          .promised = preparation->promised,
                          .class = preparation->class};
    flights->disposals++;
    pool_submit(flights->pool, &disposal->job);
}

static void flight_destroy(struct flight *flight)
{
    flights_dispose(flight->flights, flight->preparation);
    blob_unref(flight->blob);
    memory_free(flight->flights->memory, flight);
}

static uint32_t fair_priority(int priority)
{
    return priority > 0 ? 0 : priority == 0 ? 1 : 2;
}

static enum admission_class class_of(const struct flight *flight)
{
    return flight->exclusive ? ADMISSION_LARGE : flight->preparation->class;
}

/* Waits for memory in the name of its first waiter. */
static void wait_for_memory(struct flight *flight)
{
    enum admission_class class = class_of(flight);
    flight->state = FLIGHT_WAITING;
    fair_queue_add(&flight->flights->waiting[class], &flight->first->client->lanes[class], &flight->entry,
                   fair_priority(flight->first->priority));
}

enum bvhd_status flights_start(struct flights *flights, struct preparation *preparation, struct flight_waiter *waiter,
                               struct bvhd_error *error)
{
    struct flight *flight = memory_alloc(flights->memory, sizeof *flight);
    if (!flight) {
        flights_dispose(flights, preparation);
        return bvhd_error_set(error, BVHD_NO_MEMORY, "", "no memory for another build");
    }
    *flight =
        (struct flight){.flights = flights, .preparation = preparation, .bytes = flights_build_bytes(preparation)};
    struct flight **bucket = bucket_of(flights, &preparation->key);
    flight->next = *bucket;
    *bucket = flight;
    flight_join(flight, waiter);
    waiter->own = true;
    wait_for_memory(flight);
    return BVHD_OK;
}

void flight_join(struct flight *flight, struct flight_waiter *waiter)
{
    waiter->flight = flight;
    waiter->own = false;
    waiter->next = NULL;
    waiter->previous = flight->last;
    if (flight->last)
        flight->last->next = waiter;
    else
        flight->first = waiter;
    flight->last = waiter;
}

static void unlink_waiter(struct flight *flight, struct flight_waiter *waiter)
{
    if (waiter->previous)
        waiter->previous->next = waiter->next;
    else
        flight->first = waiter->next;
    if (waiter->next)
        waiter->next->previous = waiter->previous;
    else
        flight->last = waiter->previous;
    waiter->flight = NULL;
    waiter->previous = waiter->next = NULL;
}

/* Nobody waits any more. */
static void abandon(struct flight *flight)
{
    leave_table(flight);
    if (flight->state == FLIGHT_BUILDING) {
        flight->state = FLIGHT_ABANDONED;
        pool_cancel(flight->flights->pool, &flight->job);
    } else {
        flight_destroy(flight);
    }
}

void flight_leave(struct flights *flights, struct flight_waiter *waiter)
{
    struct flight *flight = waiter->flight;
    if (!flight)
        return;
    bool was_first = flight->first == waiter;
    unlink_waiter(flight, waiter);
    if (was_first)
        fair_queue_remove(&flights->waiting[class_of(flight)], &flight->entry);
    if (!flight->first)
        abandon(flight);
    else if (was_first && flight->state == FLIGHT_WAITING)
        wait_for_memory(flight);
}

/* On a worker. */
static enum bvhd_status build_blob(struct flight *flight, const struct parallel *parallel)
{
    struct preparation *preparation = flight->preparation;
    struct memory memory;
    struct blob_writer writer;
    struct build_stats stats;
    unsigned char *bytes;
    memory_init_within(&memory, class_of(flight) == ADMISSION_LARGE ? flight->flights->large : flight->flights->memory,
                       UINT64_MAX);
    blob_writer_init(&writer, flight->flights->account);
    const struct build_context context = {
        .memory = &memory, .parallel = parallel, .cancel = &flight->job.cancel, .output = &writer.output};
    enum bvhd_status status =
        build(&preparation->canonical, &preparation->options, &context, &bytes, &stats, &flight->error);
    if (status != BVHD_OK) {
        if (status == BVHD_NO_MEMORY && writer.error.status != BVHD_OK) {
            flight->error = writer.error;
            status = writer.error.status;
        }
        blob_writer_discard(&writer);
        return status;
    }
    status = blob_writer_finish(&writer, &flight->blob, &flight->error);
    if (status != BVHD_OK)
        return status;
    flight->blob->key = preparation->key;
    flight->blob->target = preparation->options.target;
    flight->blob->stats = stats;
    flight->blob->peak_bytes = atomic_load_explicit(&memory.peak, memory_order_relaxed);
    return BVHD_OK;
}

static struct flight *flight_of(struct pool_job *job)
{
    return (struct flight *)(void *)((unsigned char *)job - offsetof(struct flight, job));
}

static bool is_shortage(enum bvhd_status status)
{
    return status == BVHD_NO_MEMORY || status == BVHD_BUSY;
}

/* The copy goes here, where it takes no time from the loop; after a shortage it may be needed again. */
static void build_run(struct pool_job *job, const struct parallel *parallel)
{
    struct flight *flight = flight_of(job);
    flight->status = build_blob(flight, parallel);
    if (!is_shortage(flight->status))
        prepare_finish(&flight->preparation->canonical, &flight->preparation->memory);
}

static void count_end(struct flight *flight)
{
    struct counters *counters = flight->flights->counters;
    counters->builds_done += flight->status == BVHD_OK;
    counters->builds_cancelled += flight->status == BVHD_CANCELLED;
    counters->builds_failed += flight->status != BVHD_OK && flight->status != BVHD_CANCELLED;
}

static void log_end(const struct flight *flight, double ms)
{
    char key[KEY_TEXT_SIZE];
    key_to_text(&flight->preparation->key, key);
    if (flight->status == BVHD_OK)
        log_event(LOG_DEBUG, "build_done", "key=%.8s ms=%.3f bytes=%llu peak=%llu", key, ms,
                  (unsigned long long)flight->blob->size, (unsigned long long)flight->blob->peak_bytes);
    else
        log_event(flight->status == BVHD_INTERNAL ? LOG_ERROR : LOG_DEBUG, "build_failed",
                  "key=%.8s ms=%.3f status=%s why=%s", key, ms, bvhd_status_name(flight->status),
                  log_quote(flight->error.text).text);
}

/* Waiters hear of it one by one; each may do anything but join this flight, which has left the table. */
static void land(struct flight *flight, double ms)
{
    struct flight_landing landing = {.blob = flight->blob, .error = &flight->error, .build_ms = ms};
    leave_table(flight);
    while (flight->first) {
        struct flight_waiter *waiter = flight->first;
        unlink_waiter(flight, waiter);
        landing.own = waiter->own;
        waiter->landed(waiter, &landing);
    }
}

static void build_done(struct pool_job *job)
{
    struct flight *flight = flight_of(job);
    struct flights *flights = flight->flights;
    double ms = job->ran ? (double)(job->ended_ns - job->started_ns) * 1e-6 : 0;
    if (!job->ran)
        flight->status = bvhd_error_set(&flight->error, BVHD_CANCELLED, "", "cancelled");
    flights->running--;
    enum admission_class class = class_of(flight);
    flights->admission->exclusive = flights->admission->exclusive && class == ADMISSION_SMALL;
    admission_end(&flights->admission->builds[class], flight->bytes);

    bool alone = !flight->accompanied && flight->started == flights->started;
    if (is_shortage(flight->status) && flight->state == FLIGHT_BUILDING && !alone && !flight->exclusive) {
        flight->exclusive = true;
        flights->counters->builds_retried++;
        wait_for_memory(flight);
        return;
    }
    count_end(flight);
    log_end(flight, ms);
    if (flight->blob) {
        flight->blob->build_ms = ms;
        cache_put(flights->cache, flight->blob);
    }
    if (flight->state == FLIGHT_BUILDING)
        land(flight, ms);
    flight_destroy(flight);
}

static void start_build(struct flight *flight)
{
    struct flights *flights = flight->flights;
    struct flight_waiter *first = flight->first;
    enum admission_class class = class_of(flight);
    flight->accompanied =
        flights->admission->builds[ADMISSION_SMALL].count + flights->admission->builds[ADMISSION_LARGE].count > 0;
    flight->started = ++flights->started;
    admission_give(&flights->admission->builds[class], flight->bytes);
    flights->admission->exclusive = flights->admission->exclusive || flight->exclusive;
    flight->state = FLIGHT_BUILDING;
    flight->job = (struct pool_job){
        .run = build_run,
        .done = build_done,
        .flow = first->client->flow,
        .size = flight->preparation->canonical.primitive_count,
        .priority = 2 * first->priority + 1,
    };
    flights->running++;
    flights->counters->builds_started++;
    pool_submit(flights->pool, &flight->job);
}

static struct flight *flight_of_entry(struct fair_entry *entry)
{
    return (struct flight *)(void *)((unsigned char *)entry - offsetof(struct flight, entry));
}

static void pump_class(struct flights *flights, enum admission_class class)
{
    struct fair_queue *waiting = &flights->waiting[class];
    struct fair_entry *entry;
    while ((entry = fair_queue_peek(waiting))) {
        struct flight *flight = flight_of_entry(entry);
        if (!admission_may_build(flights->admission, class, flight->bytes, flight->exclusive))
            return;
        fair_queue_pop(waiting, flight->bytes);
        start_build(flight);
    }
}

void flights_pump(struct flights *flights)
{
    pump_class(flights, ADMISSION_SMALL);
    pump_class(flights, ADMISSION_LARGE);
}
