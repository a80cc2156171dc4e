/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <stdlib.h>
#include <unistd.h>

#include "proto/base/clock.h"
#include "builder/method.h"
#include "daemon/system/log.h"
#include "daemon/system/machine.h"
#include "daemon/system/release.h"
#include "daemon/service/service_internal.h"

enum {
    DEFAULT_CREDITS = 1024,
    DEFAULT_QUEUE = 16384,
    DEFAULT_POOL = 64 << 20,
    DEFAULT_CACHE = 1 << 30,
    DEFAULT_SLOW_MS = 10000
};

/* Results in memory may by default take the memory of the machine, or of the control group, divided by this. */
enum { CACHE_DIVISOR = 4 };

/*
 * Inline payloads may take up to the budget divided by INLINE_DIVISOR. Large steps leave the budget divided by
 * SMALL_DIVISOR free, even if they need more than was promised to them. What all users share beside the budget is
 * bounded by parts of it: clients' pools, of which one has an eighth of the budget at most (share.h: one connection of
 * one user gets nine sixteenths of what there is), results that were not read or released, unsent replies, and frames
 * that have not arrived completely.
 */
enum {
    INLINE_DIVISOR = 8,
    SMALL_DIVISOR = 4,
    POOLS_DIVISOR = 4,
    POOL_DIVISOR = 8,
    RESULTS_DIVISOR = 2,
    REPLIES_DIVISOR = 16,
    FRAMES_DIVISOR = 8
};

/* Results that wait to be written to disk may take that many bytes, and the budget divided by QUEUE_DIVISOR. */
enum { DISK_QUEUE = 256 << 20, QUEUE_DIVISOR = 8 };

/* The same for memfds that are ready for results from disk. */
enum { DISK_READY = 32 << 20, READY_DIVISOR = 64 };

struct service_options service_options_default(void)
{
    uint64_t most = machine_memory() / CACHE_DIVISOR;
    return (struct service_options){
        .cache = most < DEFAULT_CACHE ? most : DEFAULT_CACHE,
        .disk_budget = STORE_BUDGET_DEFAULT,
        .limits = limits_default(),
        .credits = DEFAULT_CREDITS,
        .max_pool = DEFAULT_POOL,
        .slow_ms = DEFAULT_SLOW_MS,
        .max_queue = DEFAULT_QUEUE,
    };
}

static struct service_options complete(const struct service_options *options)
{
    struct service_options result = *options;
    if (result.memory == 0)
        result.memory = machine_memory() / 2;
    if (result.memory < SERVICE_LEAST_MEMORY)
        result.memory = SERVICE_LEAST_MEMORY;
    if (result.max_pool > result.memory / POOL_DIVISOR)
        result.max_pool = result.memory / POOL_DIVISOR;
    return result;
}

static enum bvhd_status out_of_memory(struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, "", "no memory for the service");
}

/* Initialises the members that need no memory. */
static void init_accounts(struct service *service)
{
    const struct service_options *options = &service->options;
    memory_init(&service->memory, options->memory);
    memory_init_within(&service->inlines, &service->memory, options->memory / INLINE_DIVISOR);
    memory_init_within(&service->large, &service->memory, options->memory - options->memory / SMALL_DIVISOR);
    memory_init(&service->unlimited, UINT64_MAX);
    descriptors_init(&service->descriptors);
    blob_account_init(&service->account, &service->unlimited, &service->descriptors);
    service->admission =
        (struct admission){.limit = options->memory, .memory = {&service->memory, &service->large, &service->large}};
    memory_queue_init(&service->preparing, &service->admission, ADMISSION_PREPARE);
    service->started_ns = clock_ns();
}

static void init_users(struct service *service)
{
    const struct service_options *options = &service->options;
    service->users = (struct users){
        .root.limit = {[SHARE_ITEMS] = options->max_queue,
                       [SHARE_INLINE] = options->memory / INLINE_DIVISOR,
                       [SHARE_POOL] = options->memory / POOLS_DIVISOR,
                       [SHARE_MEMFDS] = service->descriptors.limit / 2,
                       [SHARE_RESULTS] = options->memory / RESULTS_DIVISOR,
                       [SHARE_AHEAD] = options->memory / RESULTS_DIVISOR,
                       [SHARE_REPLIES] = options->memory / REPLIES_DIVISOR,
                       [SHARE_FRAMES] = options->memory / FRAMES_DIVISOR},
        .memory = &service->memory,
        .pool = service->pool,
        .preparing = &service->preparing,
    };
}

static uint64_t part_of(uint64_t memory, uint64_t divisor, uint64_t most)
{
    return memory / divisor < most ? memory / divisor : most;
}

/* The service works without a cache on disk, too, if it cannot have one. */
static void open_disk(struct service *service)
{
    const struct service_options *options = &service->options;
    const struct disk_options disk = {
        .directory = options->disk_directory,
        .budget = options->disk_budget,
        .queue = part_of(options->memory, QUEUE_DIVISOR, DISK_QUEUE),
        .ready = part_of(options->memory, READY_DIVISOR, DISK_READY),
        .readers = pool_threads(service->pool),
    };
    struct bvhd_error error;
    if (!options->disk_directory || disk_open(&disk, &service->account, &service->disk, &error) == BVHD_OK)
        return;
    log_event(LOG_WARNING, "no_disk_cache", "dir=%s where=%s why=%s", log_quote(options->disk_directory).text,
              log_quote(error.where).text, log_quote(error.text).text);
}

static enum bvhd_status create_modules(struct service *service, void (*wake)(void *context), void *wake_context,
                                       struct bvhd_error *error)
{
    enum bvhd_status status = pool_create(service->options.workers, wake, wake_context, &service->pool, error);
    if (status != BVHD_OK)
        return status;
    init_users(service);
    service->cache = cache_create(service->options.cache, &service->unlimited);
    service->disposals = (struct disposals){
        .pool = service->pool,
        .flow = pool_flow_create(service->pool, NULL),
        .memory = &service->memory,
        .admission = &service->admission,
    };
    if (!service->disposals.flow || !service->cache)
        return out_of_memory(error);
    open_disk(service);
    service->flights = (struct flights){
        .pool = service->pool,
        .memory = &service->memory,
        .disposals = &service->disposals,
        .cache = service->cache,
        .disk = service->disk,
        .account = &service->account,
        .counters = &service->counters,
    };
    return flights_init(&service->flights, service->options.max_queue, &service->admission, error);
}

static void destroy_modules(struct service *service)
{
    if (service->flights.buckets)
        flights_finish(&service->flights);
    if (service->disposals.flow)
        pool_flow_end(service->pool, service->disposals.flow);
    pool_destroy(service->pool);
    disk_close(service->disk);
    cache_destroy(service->cache);
}

/* With fewer, nobody could be served: the daemon would listen, but accept no client. */
static enum bvhd_status check_descriptors(const struct descriptors *descriptors, struct bvhd_error *error)
{
    if (descriptors->limit >= DESCRIPTORS_LEAST)
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_IO, "file descriptors",
                          "%u can be opened, and at least %d are needed: raise the limit (ulimit -n, LimitNOFILE=)",
                          descriptors->limit, DESCRIPTORS_LEAST);
}

enum bvhd_status service_create(const struct service_options *options, void (*wake)(void *context), void *wake_context,
                                struct service **ret_service, struct bvhd_error *error)
{
    struct service *service = calloc(1, sizeof *service);
    if (!service)
        return out_of_memory(error);
    service->options = complete(options);
    service->wake = wake;
    service->wake_context = wake_context;
    service->builders = method_builders();
    init_accounts(service);
    enum bvhd_status status = check_descriptors(&service->descriptors, error);
    if (status == BVHD_OK)
        status = create_modules(service, wake, wake_context, error);
    if (status != BVHD_OK) {
        destroy_modules(service);
        free(service);
        return status;
    }
    *ret_service = service;
    return BVHD_OK;
}

void service_reconfigure(struct service *service, const struct service_options *options)
{
    struct service_options completed = complete(options);
    service->options.slow_ms = completed.slow_ms;
    service->options.cache = completed.cache;
    cache_resize(service->cache, completed.cache);
    service->wake(service->wake_context);
}

/*
 * Waits until the workers have nothing of the service any more. No client waits for a result by then, and all jobs have
 * been told to stop. The counts are those of the loop, not of the pool, whose ended jobs may still have to be
 * collected.
 */
static void await_workers(struct service *service)
{
    static const struct timespec moment = {.tv_nsec = 200 * 1000};
    for (;;) {
        while (service_collect(service))
            ;
        if (service->flights.looking == 0 && service->flights.running == 0 && service->disposals.running == 0 &&
            service->cache_tasks == 0 && !service->sessions.all.first)
            return;
        nanosleep(&moment, NULL);
    }
}

void service_destroy(struct service *service)
{
    if (!service)
        return;
    assert(service->sessions.open == 0);
    await_workers(service);
    destroy_modules(service);
    assert(atomic_load(&service->memory.live) == 0 && atomic_load(&service->unlimited.live) == 0);
    free(service);
}

void service_pump(struct service *service)
{
    users_review(&service->users);
    memory_queue_start(&service->preparing);
    flights_pump(&service->flights);
    deferred_run(&service->deferred);
    if (admission_is_exhausted(&service->admission))
        service->wake(service->wake_context);
}

bool service_collect(struct service *service)
{
    admission_begin_iteration(&service->admission);
    bool more = pool_collect(service->pool);
    if (cache_trim(service->cache)) {
        service->wake(service->wake_context);
        more = true;
    }
    service_pump(service);
    return more;
}

void service_rest(struct service *service)
{
    release_flush();
    if (service->disk)
        disk_rest(service->disk);
}

void service_drain(struct service *service)
{
    service->draining = true;
}

uint32_t service_pending(const struct service *service)
{
    return (uint32_t)service_uses(service, SHARE_ITEMS);
}

uint64_t service_memory_limit(const struct service *service)
{
    return service->memory.limit;
}

struct memory *service_frame_memory(struct service *service)
{
    return &service->unlimited;
}

struct descriptors *service_descriptors(struct service *service)
{
    return &service->descriptors;
}

struct pool *service_pool(struct service *service)
{
    return service->pool;
}

bool service_is_building(const struct service *service)
{
    return service->flights.running > 0;
}

bool service_has_deadlines(const struct service *service)
{
    return service->with_deadline > 0;
}

void service_count_connections(struct service *service, uint32_t open)
{
    service->connections = open;
}

void service_count_refusal(struct service *service)
{
    service->counters.connections_refused++;
}

static void count_disk(const struct service *service, struct counters *counters)
{
    if (!service->disk)
        return;
    struct disk_state state = disk_state(service->disk);
    counters->disk_written = state.store.written;
    counters->disk_write_errors = state.store.write_errors;
    counters->disk_write_dropped = state.dropped;
    counters->disk_read_errors = state.read_errors;
    counters->disk_damaged = state.store.damaged;
    counters->disk_evicted = state.store.evicted;
    counters->disk_entries = state.store.entries;
    counters->disk_bytes = state.store.bytes;
    counters->disk_budget = state.store.budget;
    counters->disk_queue_bytes = state.queued_bytes;
    counters->disk_ready_bytes = state.ready_bytes;
}

static void count_memory(const struct service *service, struct counters *counters)
{
    struct cache_load cache = cache_load(service->cache);
    counters->cache_entries = cache.entries;
    counters->cache_bytes = cache.bytes;
    counters->cache_evicted = cache.evicted;
    counters->cache_budget = cache.budget;
    counters->live_results = atomic_load_explicit(&service->account.live_blobs, memory_order_relaxed);
    counters->live_result_bytes = atomic_load_explicit(&service->account.live_bytes, memory_order_relaxed);
    counters->memory_live = atomic_load_explicit(&service->memory.live, memory_order_relaxed);
    counters->memory_peak = atomic_load_explicit(&service->memory.peak, memory_order_relaxed);
    counters->memory_limit = service->memory.limit;
    counters->memory_promised = admission_promised(&service->admission);
    counters->results_held_bytes = service_uses(service, SHARE_RESULTS);
    counters->pool_bytes = service_uses(service, SHARE_POOL);
    counters->descriptors_limit = service->descriptors.limit;
    counters->descriptors_used = service->descriptors.limit - descriptors_left(&service->descriptors);
}

static void count_latencies(const struct service *service, struct counters *counters)
{
    uint64_t now = clock_ns();
#define COUNT(stage)                                                                                                   \
    const struct latency_summary stage = latency_summary(&service->latencies[LATENCY_##stage], now);                   \
    counters->latency_##stage##_items = stage.count;                                                                   \
    counters->latency_##stage##_p50_us = stage.p50_us;                                                                 \
    counters->latency_##stage##_p90_us = stage.p90_us;                                                                 \
    counters->latency_##stage##_p99_us = stage.p99_us;                                                                 \
    counters->latency_##stage##_max_us = stage.most_us;
    LATENCY_STAGES(COUNT)
#undef COUNT
}

struct counters service_counters(const struct service *service)
{
    struct counters counters = service->counters;
    struct pool_load load = pool_load(service->pool);
    counters.busy_ns = load.busy_ns;
    counters.active_ns = load.active_ns;
    counters.jobs_queued = load.queued;
    counters.jobs_running = load.running;
    counters.workers = pool_threads(service->pool);
    counters.pid = (uint64_t)getpid();
    counters.uptime_ms = (clock_ns() - service->started_ns) / 1000000;
    counters.connections = service->connections;
    counters.sessions = service->sessions.open + service->sessions.closing;
    counters.queue_depth = service_uses(service, SHARE_ITEMS);
    counters.prepares_waiting = memory_queue_count(&service->preparing);
    counters.builds_waiting = flights_waiting(&service->flights);
    counters.builds_running = service->flights.running;
    count_memory(service, &counters);
    count_latencies(service, &counters);
    count_disk(service, &counters);
    return counters;
}
