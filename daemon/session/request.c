/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/session/request.h"

#include <assert.h>
#include <stddef.h>

#include "builder/build.h"
#include "proto/base/clock.h"
#include "daemon/system/log.h"
#include "proto/base/place.h"

#define STATE(state) (1u << ITEM_##state)

/* What may follow each state. */
static const unsigned may_follow[ITEM_STATES] = {
    [ITEM_NEW] = STATE(WAITING) | STATE(JOINED) | STATE(ANSWERED),
    [ITEM_WAITING] = STATE(PREPARING) | STATE(ANSWERED),
    [ITEM_PREPARING] = STATE(WAITING) | STATE(JOINED) | STATE(LEAVING) | STATE(ANSWERED),
    [ITEM_JOINED] = STATE(ANSWERED),
    [ITEM_LEAVING] = STATE(ANSWERED),
};

static void set_ahead(struct item *item, uint64_t bytes)
{
    struct request_client *client = item->request->client;
    if (item->ahead == bytes)
        return;
    client->ahead += bytes - item->ahead;
    item->ahead = bytes;
    if (!client->gone)
        client->events->moved(client);
}

static void enter(struct item *item, enum item_state state)
{
    assert(may_follow[item->state] & 1u << state);
    item->state = state;
    set_ahead(item, state == ITEM_WAITING || state == ITEM_ANSWERED ? 0 : item->promise);
    item->request->open -= state == ITEM_ANSWERED;
}

static struct service *service_of(const struct item *item)
{
    return item->request->client->service;
}

struct request *request_create(struct request_client *client, const struct request_head *head)
{
    struct memory *memory = &client->service->memory;
    struct request *request = memory_alloc(memory, sizeof *request + head->count * sizeof *request->items);
    if (!request)
        return NULL;
    memset(request, 0, sizeof *request + head->count * sizeof *request->items);
    request->client = client;
    request->number = head->number;
    request->priority = head->priority;
    request->is_build = head->is_build;
    request->arrived_ns = clock_ns();
    request->count = request->open = head->count;
    request->untold = head->is_build ? head->count : 0;
    for (uint32_t i = 0; i < head->count; i++) {
        request->items[i].request = request;
        request->items[i].index = i;
    }
    return request;
}

static void enter_news(struct request *request)
{
    struct request_news *news = &request->client->service->news;
    request->next_news = NULL;
    request->previous_news = news->last;
    if (news->last)
        news->last->next_news = request;
    else
        news->first = request;
    news->last = request;
}

static void leave_news(struct request *request)
{
    struct request_news *news = &request->client->service->news;
    if (request->previous_news)
        request->previous_news->next_news = request->next_news;
    else
        news->first = request->next_news;
    if (request->next_news)
        request->next_news->previous_news = request->previous_news;
    else
        news->last = request->previous_news;
    request->to_tell = 0;
}

static void report_end(const struct request *request)
{
    log_event(LOG_DEBUG, "request_done", "request=%llu kind=%s items=%u ms=%.3f", (unsigned long long)request->number,
              request->is_build ? "build" : "get", request->count, (double)(clock_ns() - request->arrived_ns) * 1e-6);
}

void request_settle(struct request *request)
{
    struct request_client *client = request->client;
    struct memory *memory = &client->service->memory;
    if (request->open > 0 || (request->untold > 0 && !client->gone))
        return;
    if (request->to_tell > 0)
        leave_news(request);
    report_end(request);
    client->events->ended(client, request);
    memory_free(memory, request->destinations);
    memory_free(memory, request);
}

/* Notes it for request_tell. */
static void note_prepared(struct item *item)
{
    struct request *request = item->request;
    struct request_client *client = request->client;
    assert(!item->is_prepared);
    item->is_prepared = true;
    if (item->pooled)
        client->events->unpooled(client);
    if (request->to_tell++ == 0)
        enter_news(request);
}

static void answer(struct item *item, struct control_result *result, struct blob *blob)
{
    struct request *request = item->request;
    if (request->client->gone)
        return;
    double total = (double)(clock_ns() - request->arrived_ns) * 1e-6;
    double rest = total - item->prepare_ms - result->build_ms;
    result->item = item->index;
    result->prepare_ms = item->prepare_ms;
    result->queued_ms = rest > 0 ? rest : 0;
    request->client->events->result(request->client, request, result, blob);
}

static void answer_error(struct item *item, const struct bvhd_error *error)
{
    if (error->status == BVHD_INTERNAL || error->status == BVHD_IO)
        log_event(error->status == BVHD_INTERNAL ? LOG_ERROR : LOG_WARNING, "item_failed", "status=%s why=%s",
                  bvhd_status_name(error->status), log_quote(error->text).text);
    struct control_result result = {.error = *error};
    answer(item, &result, NULL);
}

static struct control_summary summary_of(const struct blob *blob)
{
    const struct build_stats *stats = &blob->stats;
    struct control_summary summary = {
        .primitives = stats->primitives,
        .triangles = stats->triangles,
        .instances = stats->instances,
        .inactive = stats->inactive,
        .degenerate = stats->degenerate,
        .skipped = stats->skipped,
        .refs = stats->refs,
        .peak_bytes = blob->peak_bytes,
        .depth = stats->depth,
        .target = blob->target,
        .quality = stats->quality,
        .sah = stats->sah,
        .build_ms = blob->build_ms,
    };
    snprintf(summary.method, sizeof summary.method, "%s", stats->method);
    memcpy(summary.bounds, &stats->bounds, sizeof summary.bounds);
    memcpy(summary.slabs, &stats->slabs, sizeof summary.slabs);
    return summary;
}

static void answer_blob(struct item *item, struct blob *blob, enum result_origin origin, double build_ms)
{
    struct control_result result = {
        .key = blob->key, .size = blob->size, .origin = origin, .build_ms = build_ms, .summary = summary_of(blob)};
    answer(item, &result, blob);
}

static void drop_source(struct preparation_source *source)
{
    payload_unref(source->payload);
    attachment_unref(source->attachment);
    *source = (struct preparation_source){0};
}

void item_refuse(struct item *item, const struct bvhd_error *error)
{
    enter(item, ITEM_ANSWERED);
    drop_source(&item->source);
    if (item->request->is_build)
        note_prepared(item);
    answer_error(item, error);
}

static uint32_t fair_priority(int priority)
{
    return priority > 0 ? 0 : priority == 0 ? 1 : 2;
}

static enum admission_class class_of(const struct item *item)
{
    return admission_class_of(&service_of(item)->admission, item->promise);
}

static void wait_for_memory(struct item *item)
{
    struct request *request = item->request;
    enum admission_class class = class_of(item);
    enter(item, ITEM_WAITING);
    fair_queue_add(&service_of(item)->preparing[class], &request->client->lanes[class], &item->entry,
                   fair_priority(request->priority));
}

/* Nothing of it is with a worker. */
static void fail(struct item *item, const struct bvhd_error *error)
{
    enter(item, ITEM_ANSWERED);
    if (!item->is_prepared && item->request->is_build)
        note_prepared(item);
    answer_error(item, error);
}

static bool is_possible(struct item *item, struct bvhd_error *error)
{
    uint64_t limit = service_of(item)->large.limit;
    if (item->promise <= limit)
        return true;
    bvhd_error_set(error, BVHD_TOO_LARGE, place("infos[%u]", item->index).text,
                   "its canonical copy may take %llu bytes, of which the service has %llu",
                   (unsigned long long)item->promise, (unsigned long long)limit);
    return false;
}

void item_start(struct item *item)
{
    struct bvhd_error error;
    item->promise = preparation_guess(&item->asked);
    if (is_possible(item, &error))
        wait_for_memory(item);
    else
        item_refuse(item, &error);
}

static struct item *item_of_waiter(struct flight_waiter *waiter)
{
    return (struct item *)(void *)((unsigned char *)waiter - offsetof(struct item, waiter));
}

static void landed(struct flight_waiter *waiter, const struct flight_landing *landing)
{
    struct item *item = item_of_waiter(waiter);
    enter(item, ITEM_ANSWERED);
    if (landing->blob)
        answer_blob(item, landing->blob, landing->own ? ORIGIN_BUILT : ORIGIN_COALESCED,
                    landing->own ? landing->build_ms : 0);
    else
        answer_error(item, landing->error);
    request_settle(item->request);
}

static struct flight_waiter *waiter_of(struct item *item)
{
    struct request *request = item->request;
    item->waiter =
        (struct flight_waiter){.landed = landed, .client = &request->client->flights, .priority = request->priority};
    return &item->waiter;
}

/* Answers with what the cache has, or waits for a build that is under way. */
static bool join_or_answer(struct item *item, struct blob *blob)
{
    struct service *service = service_of(item);
    struct flight *flight = blob ? NULL : flights_find(&service->flights, &item->key);
    if (blob) {
        enter(item, ITEM_ANSWERED);
        service->counters.hits_memory++;
        answer_blob(item, blob, ORIGIN_MEMORY, 0);
    } else if (flight) {
        enter(item, ITEM_JOINED);
        service->counters.coalesced++;
        flight_join(flight, waiter_of(item));
    } else {
        service->counters.misses++;
        return false;
    }
    return true;
}

static void get_looked_up(void *context, struct blob *blob)
{
    struct item *item = context;
    struct bvhd_error error;
    if (join_or_answer(item, blob))
        return;
    bvhd_error_set(&error, BVHD_NOT_FOUND, place("keys[%u]", item->index).text, "no structure of this key is known");
    item_refuse(item, &error);
}

void item_get(struct item *item, const struct key *key)
{
    item->key = *key;
    cache_get(service_of(item)->cache, key, get_looked_up, item);
}

static struct preparation *take_preparation(struct item *item)
{
    struct preparation *preparation = item->preparation;
    item->preparation = NULL;
    return preparation;
}

static void start_flight(struct item *item)
{
    struct service *service = service_of(item);
    struct bvhd_error error;
    enum bvhd_status status = flights_start(&service->flights, take_preparation(item), waiter_of(item), &error);
    if (status == BVHD_OK)
        enter(item, ITEM_JOINED);
    else
        fail(item, &error);
}

static void build_looked_up(void *context, struct blob *blob)
{
    struct item *item = context;
    if (join_or_answer(item, blob))
        flights_dispose(&service_of(item)->flights, take_preparation(item));
    else
        start_flight(item);
}

/* The rows asked for more memory than was promised. */
static void ask_for_more(struct item *item)
{
    struct service *service = service_of(item);
    struct bvhd_error error;
    admission_end(&service->admission.prepares[item->preparation->class], item->preparation->promised);
    item->promise = item->preparation->needed;
    if (is_possible(item, &error)) {
        wait_for_memory(item);
        return;
    }
    preparation_destroy(take_preparation(item));
    fail(item, &error);
}

/* From now on the promise is what the copy holds. */
static void trim_promise(struct item *item)
{
    struct preparation *preparation = item->preparation;
    uint64_t held = atomic_load_explicit(&preparation->memory.live, memory_order_relaxed) + sizeof *preparation;
    struct admission_share *share = &service_of(item)->admission.prepares[preparation->class];
    share->bytes -= preparation->promised - (held < preparation->promised ? held : preparation->promised);
    preparation->promised = held < preparation->promised ? held : preparation->promised;
}

static void leave_worker(struct item *item)
{
    flights_dispose(&service_of(item)->flights, take_preparation(item));
    enter(item, ITEM_ANSWERED);
    note_prepared(item);
}

static void finish_preparing(struct item *item)
{
    struct service *service = service_of(item);
    struct preparation *preparation = item->preparation;
    note_prepared(item);
    trim_promise(item);
    service->counters.prepares_done += preparation->status == BVHD_OK;
    service->counters.prepares_failed += preparation->status != BVHD_OK;
    if (preparation->status == BVHD_OK) {
        item->key = preparation->key;
        cache_get(service->cache, &item->key, build_looked_up, item);
        return;
    }
    struct bvhd_error error = preparation->error;
    flights_dispose(&service->flights, take_preparation(item));
    fail(item, &error);
}

static struct item *item_of_job(struct pool_job *job)
{
    return (struct item *)(void *)((unsigned char *)job - offsetof(struct item, job));
}

static void prepare_run(struct pool_job *job, const struct parallel *parallel)
{
    preparation_run(item_of_job(job)->preparation, parallel, &job->cancel);
}

static void prepare_done(struct pool_job *job)
{
    struct item *item = item_of_job(job);
    struct request *request = item->request;
    if (job->ran)
        item->prepare_ms += (double)(job->ended_ns - job->started_ns) * 1e-6;
    if (item->state == ITEM_LEAVING)
        leave_worker(item);
    else if (item->preparation->needed > 0)
        ask_for_more(item);
    else
        finish_preparing(item);
    request_settle(request);
}

/* Promised memory is there; the structs beside it may still fail. */
static bool make_preparation(struct item *item)
{
    struct service *service = service_of(item);
    struct request *request = item->request;
    if (item->preparation)
        return true;
    item->preparation = preparation_create(&item->asked, item->index, &item->source, &service->memory);
    item->source = (struct preparation_source){0};
    if (!item->preparation)
        return false;
    item->preparation->batch = (struct preparation_batch){request->destinations, request->destination_count};
    item->preparation->limits = &service->options.limits;
    return true;
}

static void start_preparing(struct item *item)
{
    struct service *service = service_of(item);
    struct bvhd_error error;
    if (!make_preparation(item)) {
        struct request *request = item->request;
        bvhd_error_set(&error, BVHD_NO_MEMORY, place("infos[%u]", item->index).text, "no memory to begin with");
        fail(item, &error);
        request_settle(request);
        return;
    }
    enum { BYTES_A_PRIMITIVE = 384 }; /* that are prepared in the time in which one primitive is built */
    item->preparation->promised = item->promise;
    item->preparation->class = class_of(item);
    preparation_account(item->preparation,
                        item->preparation->class == ADMISSION_LARGE ? &service->large : &service->memory);
    admission_give(&service->admission.prepares[item->preparation->class], item->promise);
    enter(item, ITEM_PREPARING);
    item->job = (struct pool_job){
        .run = prepare_run,
        .done = prepare_done,
        .flow = item->request->client->flights.flow,
        .size = item->promise / BYTES_A_PRIMITIVE,
        .priority = 2 * item->request->priority,
    };
    service->counters.prepares_started++;
    pool_submit(service->pool, &item->job);
}

static struct item *item_of_entry(struct fair_entry *entry)
{
    return (struct item *)(void *)((unsigned char *)entry - offsetof(struct item, entry));
}

static void pump_class(struct service *service, enum admission_class class)
{
    struct fair_queue *waiting = &service->preparing[class];
    struct fair_entry *entry;
    while ((entry = fair_queue_peek(waiting))) {
        struct item *item = item_of_entry(entry);
        if (!admission_may_prepare(&service->admission, class, item->promise))
            return;
        fair_queue_pop(waiting, item->promise);
        start_preparing(item);
    }
}

void request_pump(struct service *service)
{
    pump_class(service, ADMISSION_SMALL);
    pump_class(service, ADMISSION_LARGE);
}

/* Its place in queues and flights goes; what a worker has stays until it lets go. */
static void withdraw(struct item *item)
{
    struct service *service = service_of(item);
    switch (item->state) {
    case ITEM_WAITING:
        fair_queue_remove(&service->preparing[class_of(item)], &item->entry);
        drop_source(&item->source);
        preparation_destroy(take_preparation(item));
        enter(item, ITEM_ANSWERED);
        note_prepared(item);
        break;
    case ITEM_PREPARING:
        enter(item, ITEM_LEAVING);
        pool_cancel(service->pool, &item->job);
        break;
    default:
        flight_leave(&service->flights, &item->waiter);
        enter(item, ITEM_ANSWERED);
    }
}

void item_cancel(struct item *item)
{
    struct bvhd_error error;
    if (item->state == ITEM_LEAVING || item->state == ITEM_ANSWERED)
        return;
    withdraw(item);
    service_of(item)->counters.cancelled++;
    bvhd_error_set(&error, BVHD_CANCELLED, "", "cancelled");
    answer_error(item, &error);
}

void request_cancel(struct request *request)
{
    for (uint32_t i = 0; i < request->count; i++)
        item_cancel(&request->items[i]);
    request_settle(request);
}

/*
 * Marks what the client is told now, and lists it; false without memory for the list, when what is marked is lost with
 * the connection.
 */
static bool list_news(struct request *request, struct memory *memory, struct control_items *ret_items)
{
    struct control_items items = {0, memory_array(memory, request->to_tell, sizeof *items.items)};
    for (uint32_t i = 0; i < request->count; i++) {
        struct item *item = &request->items[i];
        if (!item->is_prepared || item->is_told)
            continue;
        item->is_told = true;
        if (items.items)
            items.items[items.count++] = i;
    }
    if (items.items)
        *ret_items = items;
    return items.items != NULL;
}

static void tell_request(struct request *request)
{
    struct request_client *client = request->client;
    struct memory *memory = &client->service->replies;
    struct control_items items = {0, NULL};
    bool listed = !client->gone && list_news(request, memory, &items);
    request->untold -= request->to_tell;
    leave_news(request);
    if (!client->gone)
        client->events->prepared(client, request, listed ? &items : NULL);
    memory_free(memory, items.items);
    request_settle(request);
}

void request_tell(struct service *service)
{
    while (service->news.first)
        tell_request(service->news.first);
}
