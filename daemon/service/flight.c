/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/flight.h"

#include <assert.h>

#include "daemon/service/blob_make.h"
#include "daemon/system/log.h"
#include "proto/base/clock.h"
#include "proto/base/container_of.h"

/*
 * LOOKING on disk, if there is one -> WAITING for memory -> BUILDING on a worker -> completed, or back to WAITING to be
 * tried again alone. A flight is ABANDONED when its last waiter has left while a worker had it: the worker has been
 * told to stop.
 */
enum flight_state { FLIGHT_LOOKING, FLIGHT_WAITING, FLIGHT_BUILDING, FLIGHT_ABANDONED };

struct flight {
    struct flights *flights;
    struct flight *next; /* in its bucket */
    enum flight_state state;
    struct key key;
    struct preparation *preparation; /* what is built; NULL while all waiters are items of GET */
    struct list waiters; /* empty while ABANDONED */
    struct flight_waiter *turn; /* the waiter in whose client's turn it goes on: one whose turn is earliest */
    struct memory_waiter memory; /* waits while WAITING; its class is ADMISSION_ALONE when the build is tried again */
    uint64_t admitted; /* admission_given when the build started */
    bool had_company; /* other builds ran, or copies of others existed, when it started */
    uint32_t attempts; /* builds that have run short of memory */
    uint64_t queued_ns; /* when it began to wait for memory */
    struct flight_times times;
    struct pool_job job;
    /* written by workers */
    _Atomic uint32_t thousandths; /* of the build that are done */
    enum bvhd_status status;
    struct bvhd_error error;
    struct blob *blob;
};

enum bvhd_status flights_init(struct flights *flights, uint32_t most, struct admission *admission,
                              struct bvhd_error *error)
{
    uint64_t size = 16;
    while (size < most)
        size *= 2;
    flights->buckets = memory_array(flights->memory, size, sizeof *flights->buckets);
    if (!flights->buckets)
        return bvhd_error_no_memory(error, "", "no memory for a table of %u builds", most);
    memset(flights->buckets, 0, size * sizeof *flights->buckets);
    flights->mask = size - 1;
    memory_queue_init(&flights->waiting, admission, ADMISSION_BUILD);
    flights->looking = 0;
    flights->running = 0;
    return BVHD_OK;
}

uint32_t flights_waiting(const struct flights *flights)
{
    return memory_queue_count(&flights->waiting);
}

void flights_finish(struct flights *flights)
{
    assert(flights->looking == 0 && flights->running == 0 && flights_waiting(flights) == 0);
    memory_free(flights->memory, flights->buckets);
    flights->buckets = NULL;
}

/* Keys are cryptographic hashes, so any of their bytes are a good hash. */
static struct flight **bucket_of(const struct flights *flights, const struct key *key)
{
    return &flights->buckets[bytes_get64(key->bytes) & flights->mask];
}

struct flight *flights_find(const struct flights *flights, const struct key *key)
{
    struct flight *flight = *bucket_of(flights, key);
    while (flight && !key_equal(&flight->key, key))
        flight = flight->next;
    return flight;
}

static void leave_table(struct flight *flight)
{
    struct flight **at = bucket_of(flight->flights, &flight->key);
    while (*at != flight)
        at = &(*at)->next;
    *at = flight->next;
}

static struct admission *admission_of(const struct flight *flight)
{
    return flight->flights->waiting.admission;
}

/* Called when the build begins to wait until it is alone, and when that is over. */
static void count_alone(struct flight *flight, int by)
{
    struct admission *admission = admission_of(flight);
    admission->alone += (uint32_t)by;
    admission->alone_copies += flight->preparation->class == ADMISSION_LARGE ? (uint32_t)by : 0;
}

static void flight_destroy(struct flight *flight)
{
    if (flight->memory.claim.class == ADMISSION_ALONE)
        count_alone(flight, -1);
    disposals_add(flight->flights->disposals, flight->preparation);
    blob_unref(flight->blob);
    memory_free(flight->flights->memory, flight);
}

/* There must be one. */
static struct flight_waiter *first_waiter(const struct flight *flight)
{
    return container_of(flight->waiters.first, struct flight_waiter, link);
}

static uint32_t count_waiters(const struct flight *flight)
{
    uint32_t count = 0;
    for (const struct list_link *link = flight->waiters.first; link; link = link->next)
        count++;
    return count;
}

/* Queues the flight in the turn of one of its waiters. */
static void wait_for_memory(struct flight *flight)
{
    flight->state = FLIGHT_WAITING;
    flight->memory.priority = flight->turn->priority;
    memory_queue_add(&flight->flights->waiting, &flight->turn->client->building, &flight->memory);
}

/* The priority of its jobs in the pool. */
static int job_priority(const struct flight_waiter *waiter)
{
    return 2 * waiter->priority + 1;
}

static bool waits_less(const struct flight *flight, const struct flight_waiter *waiter)
{
    const struct flight_waiter *turn = flight->turn;
    if (waiter->client == turn->client)
        return waiter->priority > turn->priority;
    return memory_queue_is_earlier(&flight->flights->waiting, flight->memory.claim.class, &waiter->client->building,
                                   &turn->client->building);
}

static void wait_in_turn_of(struct flight *flight, struct flight_waiter *waiter)
{
    memory_queue_remove(&flight->flights->waiting, &flight->memory);
    flight->turn = waiter;
    wait_for_memory(flight);
}

/* The flight goes on in this waiter's turn if that is earlier than its own so far. */
static void favour(struct flight *flight, struct flight_waiter *waiter)
{
    struct pool_flow *flow = waiter->client->flow;
    if (flight->state == FLIGHT_WAITING && waits_less(flight, waiter))
        wait_in_turn_of(flight, waiter);
    if (flight->state == FLIGHT_WAITING)
        return;
    pool_favour(flight->flights->pool, &flight->job, flow, job_priority(waiter));
    if (flight->job.flow == flow)
        flight->turn = waiter;
}

/* Finds the earliest turn among the first of the waiters: there may be thousands. */
static void find_turn(struct flight *flight)
{
    enum { LOOKED_AT = 64 };
    struct list_link *link = flight->waiters.first;
    for (int i = 0; i < LOOKED_AT && link; i++, link = link->next)
        if (link != &flight->turn->link)
            favour(flight, container_of(link, struct flight_waiter, link));
}

/* The waiter in whose turn it went on has left. */
static void change_turn(struct flight *flight)
{
    flight->turn = first_waiter(flight);
    if (flight->state == FLIGHT_WAITING)
        wait_in_turn_of(flight, flight->turn);
    else
        pool_move(flight->flights->pool, &flight->job, flight->turn->client->flow, job_priority(flight->turn));
    find_turn(flight);
}

/* Goes on to the build of its preparation. */
static void prepare_to_build(struct flight *flight)
{
    const struct preparation *preparation = flight->preparation;
    flight->memory.claim =
        (struct admission_claim){.bytes = preparation_make_bytes(preparation), .class = preparation->class};
    flight->queued_ns = clock_ns();
    wait_for_memory(flight);
}

static void add_waiter(struct flight *flight, struct preparation *preparation, struct flight_waiter *waiter)
{
    waiter->flight = flight;
    waiter->own = preparation && !flight->preparation;
    if (waiter->own)
        flight->preparation = preparation;
    else
        disposals_add(flight->flights->disposals, preparation);
    list_append(&flight->waiters, &waiter->link);
    if (flight->turn)
        favour(flight, waiter);
    else
        flight->turn = waiter;
}

/* An item that joins a lookup is counted when the lookup ends. */
void flight_join(struct flight *flight, struct preparation *preparation, struct flight_waiter *waiter)
{
    flight->flights->counters->coalesced += flight->state != FLIGHT_LOOKING;
    add_waiter(flight, preparation, waiter);
}

static void remove_waiter(struct flight *flight, struct flight_waiter *waiter)
{
    list_remove(&flight->waiters, &waiter->link);
    waiter->flight = NULL;
}

/* Its last waiter has left. */
static void abandon(struct flight *flight)
{
    leave_table(flight);
    if (flight->state != FLIGHT_WAITING) {
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
    bool had_the_turn = flight->turn == waiter;
    remove_waiter(flight, waiter);
    if (had_the_turn)
        memory_queue_remove(&flights->waiting, &flight->memory);
    if (!flight->waiters.first)
        abandon(flight);
    else if (had_the_turn)
        change_turn(flight);
}

struct pool_flow *flight_flow(const struct flight_waiter *waiter)
{
    const struct flight *flight = waiter->flight;
    return flight->state == FLIGHT_WAITING ? flight->turn->client->flow : flight->job.flow;
}

int flight_priority(const struct flight_waiter *waiter)
{
    return waiter->flight->turn->priority;
}

/* Runs on any worker. Calls may overtake each other, so a number that is less than the last one is old. */
static void note_progress(void *context, uint64_t done, uint64_t total)
{
    struct flight *flight = context;
    uint32_t thousandths = total > 0 ? (uint32_t)((double)done / (double)total * CONTROL_DONE) : CONTROL_DONE;
    uint32_t before = atomic_load_explicit(&flight->thousandths, memory_order_relaxed);
    while (before < thousandths && !atomic_compare_exchange_weak_explicit(&flight->thousandths, &before, thousandths,
                                                                          memory_order_relaxed, memory_order_relaxed)) {
    }
}

uint32_t flight_thousandths(const struct flight_waiter *waiter)
{
    const struct flight *flight = waiter->flight;
    if (!flight || flight->state != FLIGHT_BUILDING)
        return 0;
    uint32_t thousandths = atomic_load_explicit(&flight->thousandths, memory_order_relaxed);
    return thousandths < CONTROL_DONE ? thousandths : CONTROL_DONE;
}

/* Runs on a worker. */
static enum bvhd_status build_blob(struct flight *flight, const struct parallel *parallel)
{
    struct memory memory;
    memory_init_within(&memory, admission_of(flight)->memory[flight->memory.claim.class], UINT64_MAX);
    const struct build_context context = {
        .memory = &memory,
        .parallel = parallel,
        .cancel = &flight->job.cancel,
        .progress = note_progress,
        .progress_context = flight,
    };
    return blob_make(flight->preparation, flight->flights->account, &context, &flight->blob, &flight->error);
}

static struct flight *flight_of_job(struct pool_job *job)
{
    return container_of(job, struct flight, job);
}

static bool is_shortage(enum bvhd_status status)
{
    return status == BVHD_NO_MEMORY || status == BVHD_BUSY;
}

/* Frees the canonical copy, which would keep the loop; after a shortage the copy may be needed again. */
static void build_run(struct pool_job *job, const struct parallel *parallel)
{
    struct flight *flight = flight_of_job(job);
    flight->status = build_blob(flight, parallel);
    if (!is_shortage(flight->status))
        build_entry_finish(&flight->preparation->entry, &flight->preparation->memory);
}

static bool is_update(const struct flight *flight)
{
    return flight->preparation && flight->preparation->asked.mode == MODE_UPDATE;
}

static void count_end(struct flight *flight)
{
    struct counters *counters = flight->flights->counters;
    const bool update = is_update(flight);
    if (flight->status == BVHD_OK)
        ++*(update ? &counters->refits_done : &counters->builds_done);
    else if (flight->status == BVHD_CANCELLED)
        ++*(update ? &counters->refits_cancelled : &counters->builds_cancelled);
    else
        ++*(update ? &counters->refits_failed : &counters->builds_failed);
}

static void log_end(const struct flight *flight, double ms)
{
    char key[KEY_TEXT_SIZE];
    key_to_text(&flight->key, key);
    if (flight->status == BVHD_OK)
        log_event(LOG_DEBUG, "build_done", "key=%.8s ms=%.3f bytes=%llu peak=%llu", key, ms,
                  (unsigned long long)flight->blob->size, (unsigned long long)flight->blob->summary.peak_bytes);
    else
        log_event(flight->status == BVHD_INTERNAL ? LOG_ERROR : LOG_DEBUG, "build_failed",
                  "key=%.8s ms=%.3f status=%s why=%s", key, ms, bvhd_status_name(flight->status),
                  log_quote(flight->error.text).text);
}

/*
 * Tells the waiters one by one. Each may do anything then; none can join this flight, since it has left the table.
 */
static void complete(struct flight *flight)
{
    struct flight_completion completion = {.blob = flight->blob,
                                           .error = &flight->error,
                                           .times = flight->times,
                                           .waiters = count_waiters(flight),
                                           .first = true};
    bool built = flight->state == FLIGHT_BUILDING;
    leave_table(flight);
    while (flight->waiters.first) {
        struct flight_waiter *waiter = first_waiter(flight);
        completion.origin = !built ? ORIGIN_DISK : waiter->own ? ORIGIN_BUILT : ORIGIN_COALESCED;
        remove_waiter(flight, waiter);
        waiter->completed(waiter, &completion);
        completion.first = false;
    }
}

/* Returns how long the job ran, in milliseconds. */
static double run_ms(const struct pool_job *job)
{
    return job->ran ? (double)(job->ended_ns - job->started_ns) * 1e-6 : 0;
}

/* Adds the time that the job has waited for a thread. */
static void add_wait(struct flight *flight, const struct pool_job *job)
{
    flight->times.threads_ms += job->ran ? (double)(job->started_ns - job->submitted_ns) * 1e-6 : 0;
}

static void end_promise(struct flight *flight)
{
    const struct admission_claim *claim = &flight->memory.claim;
    struct admission *admission = admission_of(flight);
    admission_end(&admission->builds[claim->class], claim->bytes);
}

/*
 * True after a shortage that other builds, or copies of others, may have caused. Builds that are tried again wait for
 * each other, but their copies stay; so that all of them come to an end, none is tried more often than MOST_ATTEMPTS.
 */
static bool may_be_retried(const struct flight *flight)
{
    enum { MOST_ATTEMPTS = 4 };
    const struct admission *admission = admission_of(flight);
    bool was_alone = flight->memory.claim.class == ADMISSION_ALONE
                         ? admission->alone_copies <= 1
                         : !flight->had_company && flight->admitted == admission_given(admission);
    return is_shortage(flight->status) && flight->state == FLIGHT_BUILDING && !was_alone &&
           flight->attempts < MOST_ATTEMPTS;
}

static void try_again_alone(struct flight *flight)
{
    struct counters *counters = flight->flights->counters;
    if (flight->memory.claim.class != ADMISSION_ALONE)
        count_alone(flight, 1);
    flight->memory.claim.class = ADMISSION_ALONE;
    flight->attempts++;
    ++*(is_update(flight) ? &counters->refits_retried : &counters->builds_retried);
    wait_for_memory(flight);
}

/* The result of an update is made for one client, and its key is not asked for again. */
static void keep_on_disk(struct flight *flight)
{
    if (flight->flights->disk && !is_update(flight))
        disk_keep(flight->flights->disk, flight->blob);
}

static void build_done(struct pool_job *job)
{
    struct flight *flight = flight_of_job(job);
    struct flights *flights = flight->flights;
    struct flight_times *times = &flight->times;
    double ms = run_ms(job);
    add_wait(flight, job);
    if (!job->ran)
        flight->status = bvhd_error_set(&flight->error, BVHD_CANCELLED, "", "cancelled");
    flights->running--;
    end_promise(flight);
    if (may_be_retried(flight)) {
        times->repeated_ms = ms;
        flight->queued_ns = clock_ns();
        try_again_alone(flight);
        return;
    }
    times->build_ms = ms;
    count_end(flight);
    log_end(flight, ms);
    if (flight->blob) {
        flight->blob->summary.build_ms = ms;
        cache_put(flights->cache, flight->blob);
        keep_on_disk(flight);
    }
    if (flight->state == FLIGHT_BUILDING)
        complete(flight);
    flight_destroy(flight);
}

static struct flight *flight_of_memory(struct memory_waiter *waiter)
{
    return container_of(waiter, struct flight, memory);
}

static void start_build(struct memory_waiter *waiter)
{
    struct flight *flight = flight_of_memory(waiter);
    struct flights *flights = flight->flights;
    const struct admission *admission = admission_of(flight);
    flight->times.memory_ms += (double)(clock_ns() - flight->queued_ns) * 1e-6;
    flight->had_company = admission_has_company(admission, flight->preparation->class == ADMISSION_LARGE);
    flight->admitted = admission_given(admission);
    flight->state = FLIGHT_BUILDING;
    flight->job = (struct pool_job){
        .run = build_run,
        .done = build_done,
        .flow = flight->turn->client->flow,
        .size = flight->preparation->entry.canonical.primitive_count,
        .priority = job_priority(flight->turn),
    };
    flights->running++;
    flights->counters->builds_started += !is_update(flight);
    flights->counters->refits_started += is_update(flight);
    pool_submit(flights->pool, &flight->job);
    find_turn(flight);
}

/* ---- on disk ---- */

/* Runs on a worker. */
static void look_run(struct pool_job *job, const struct parallel *parallel)
{
    struct flight *flight = flight_of_job(job);
    flight->status =
        disk_read(flight->flights->disk, &flight->key, parallel, &job->cancel, &flight->blob, &flight->error);
}

static void count_lookup(struct flight *flight)
{
    struct counters *counters = flight->flights->counters;
    uint32_t waiters = count_waiters(flight);
    if (flight->status == BVHD_OK) {
        counters->hits_disk += waiters;
    } else if (flight->preparation) {
        counters->misses++;
        counters->coalesced += waiters - 1;
    } else {
        counters->misses += waiters;
    }
}

/* A disk that fails costs builds, and nothing else. */
static void look_done(struct pool_job *job)
{
    struct flight *flight = flight_of_job(job);
    bool left = flight->state == FLIGHT_ABANDONED;
    flight->flights->looking--;
    add_wait(flight, job);
    flight->times.disk_ms = run_ms(job);
    if (!left)
        count_lookup(flight);
    if (!left && flight->status != BVHD_OK && flight->preparation) {
        prepare_to_build(flight);
        find_turn(flight);
        return;
    }
    if (flight->blob)
        cache_put(flight->flights->cache, flight->blob);
    if (!left)
        complete(flight);
    flight_destroy(flight);
}

/* The size of the job is the least, so that a spare thread may run it while long builds have all workers. */
static void look_on_disk(struct flight *flight)
{
    flight->state = FLIGHT_LOOKING;
    flight->job = (struct pool_job){
        .run = look_run,
        .done = look_done,
        .flow = flight->turn->client->flow,
        .size = 1,
        .priority = job_priority(flight->turn),
    };
    flight->flights->looking++;
    pool_submit(flight->flights->pool, &flight->job);
}

/* ---- the start ---- */

enum bvhd_status flights_start(struct flights *flights, const struct key *key, struct preparation *preparation,
                               struct flight_waiter *waiter, struct bvhd_error *error)
{
    struct flight *flight = memory_alloc(flights->memory, sizeof *flight);
    assert(preparation || flights->disk);
    if (!flight) {
        disposals_add(flights->disposals, preparation);
        return bvhd_error_no_memory(error, "", "no memory for another build");
    }
    *flight = (struct flight){.flights = flights, .key = *key, .memory = {.start = start_build}};
    struct flight **bucket = bucket_of(flights, key);
    flight->next = *bucket;
    *bucket = flight;
    add_waiter(flight, preparation, waiter);
    if (flights->disk && !is_update(flight)) {
        look_on_disk(flight);
    } else {
        flights->counters->misses++;
        prepare_to_build(flight);
    }
    return BVHD_OK;
}

void flights_pump(struct flights *flights)
{
    memory_queue_start(&flights->waiting);
}
