/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <stdlib.h>

#include "proto/base/clock.h"
#include "daemon/system/machine.h"
#include "daemon/session/request.h"
#include "daemon/service/service_internal.h"

enum { DEFAULT_CREDITS = 1024, DEFAULT_QUEUE = 16384, DEFAULT_POOL = 64 << 20, DEFAULT_CACHE = 1 << 30 };

/* Inline payloads may take this part of the budget, pools as much beside it as session.c allows. */
enum { INLINE_PART = 8 };

struct service_options service_options_default(void)
{
    return (struct service_options){
        .cache = DEFAULT_CACHE,
        .limits = limits_default(),
        .credits = DEFAULT_CREDITS,
        .max_pool = DEFAULT_POOL,
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
    if (result.max_pool > result.memory / 4)
        result.max_pool = result.memory / 4;
    return result;
}

static enum bvhd_status out_of_memory(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_NO_MEMORY, "", "no memory for the service");
}

/* What large steps must leave, whatever they had promised. */
enum { SMALL_PART = 4 };

static void init_plain_parts(struct service *service)
{
    const struct service_options *options = &service->options;
    memory_init(&service->memory, options->memory);
    memory_init_within(&service->inlines, &service->memory, options->memory / INLINE_PART);
    memory_init_within(&service->large, &service->memory, options->memory - options->memory / SMALL_PART);
    memory_init(&service->replies, UINT64_MAX);
    descriptors_init(&service->descriptors);
    blob_account_init(&service->account, &service->replies, &service->descriptors);
    service->admission.limit = options->memory;
    service->started_ns = clock_ns();
}

static enum bvhd_status create_parts(struct service *service, void (*wake)(void *context), void *wake_context,
                                     struct bvhd_error *error)
{
    enum bvhd_status status = pool_create(service->options.workers, wake, wake_context, &service->pool, error);
    if (status != BVHD_OK)
        return status;
    service->housekeeping = pool_flow_create(service->pool);
    service->cache = cache_create(service->options.cache, &service->replies);
    if (!service->housekeeping || !service->cache)
        return out_of_memory(error);
    service->flights = (struct flights){
        .pool = service->pool,
        .housekeeping = service->housekeeping,
        .memory = &service->memory,
        .large = &service->large,
        .admission = &service->admission,
        .cache = service->cache,
        .account = &service->account,
        .counters = &service->counters,
    };
    return flights_init(&service->flights, service->options.max_queue, error);
}

static void destroy_parts(struct service *service)
{
    if (service->flights.buckets)
        flights_finish(&service->flights);
    if (service->housekeeping)
        pool_flow_end(service->pool, service->housekeeping);
    pool_destroy(service->pool);
    cache_destroy(service->cache);
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
    init_plain_parts(service);
    enum bvhd_status status = create_parts(service, wake, wake_context, error);
    if (status != BVHD_OK) {
        destroy_parts(service);
        free(service);
        return status;
    }
    *ret_service = service;
    return BVHD_OK;
}

/*
 * Nobody waits for anything any more; what workers still have they have been told to leave. Counted here, not by the
 * pool: what has ended there may still have to be collected.
 */
static void await_workers(struct service *service)
{
    static const struct timespec moment = {.tv_nsec = 200 * 1000};
    const struct flights *flights = &service->flights;
    for (;;) {
        while (service_collect(service))
            ;
        if (flights->running == 0 && flights->disposals == 0 && !service->sessions)
            return;
        nanosleep(&moment, NULL);
    }
}

void service_destroy(struct service *service)
{
    if (!service)
        return;
    assert(service->session_count == 0);
    await_workers(service);
    destroy_parts(service);
    assert(atomic_load(&service->memory.live) == 0 && atomic_load(&service->replies.live) == 0);
    free(service);
}

void service_pump(struct service *service)
{
    request_pump(service);
    flights_pump(&service->flights);
    request_tell(service);
    if (admission_turn_is_over(&service->admission))
        service->wake(service->wake_context);
}

bool service_collect(struct service *service)
{
    admission_begin_turn(&service->admission);
    bool more = pool_collect(service->pool);
    if (cache_trim(service->cache)) {
        service->wake(service->wake_context);
        more = true;
    }
    service_pump(service);
    return more;
}

void service_drain(struct service *service)
{
    service->draining = true;
}

uint32_t service_pending(const struct service *service)
{
    return service->under_way;
}

struct memory *service_frame_memory(struct service *service)
{
    return &service->replies;
}

struct descriptors *service_descriptors(struct service *service)
{
    return &service->descriptors;
}

struct pool *service_pool(struct service *service)
{
    return service->pool;
}

void service_count_connections(struct service *service, uint32_t open)
{
    service->connections = open;
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
    counters->pool_bytes = service->pool_bytes;
    counters->descriptors_limit = service->descriptors.limit;
    counters->descriptors_used = service->descriptors.limit - descriptors_left(&service->descriptors);
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
    counters.uptime_ms = (clock_ns() - service->started_ns) / 1000000;
    counters.connections = service->connections;
    counters.sessions = service->session_count + service->closing_count;
    counters.queue_depth = service->under_way;
    counters.prepares_waiting = service->preparing[ADMISSION_SMALL].count + service->preparing[ADMISSION_LARGE].count;
    counters.builds_waiting = flights_waiting(&service->flights);
    counters.builds_running = service->flights.running;
    count_memory(service, &counters);
    return counters;
}
