/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/session/item_internal.h"

#include <assert.h>

#include "daemon/system/log.h"
#include "proto/base/clock.h"
#include "proto/base/container_of.h"
#include "proto/base/place.h"

#define STATE(state) (1u << ITEM_##state)

/* The states that may follow each state. */
static const unsigned may_follow[ITEM_STATES] = {
    [ITEM_NEW] = STATE(WAITING) | STATE(JOINED) | STATE(ANSWERED),
    [ITEM_WAITING] = STATE(PREPARING) | STATE(JOINED) | STATE(ANSWERED),
    [ITEM_PREPARING] = STATE(WAITING) | STATE(JOINED) | STATE(LEAVING) | STATE(ANSWERED),
    [ITEM_JOINED] = STATE(ANSWERED),
    [ITEM_LEAVING] = STATE(ANSWERED),
};

static void set_started(struct item *item, uint64_t bytes)
{
    struct request_client *client = item->request->client;
    if (item->started_bytes == bytes)
        return;
    client->started_bytes += bytes - item->started_bytes;
    user_take(&client->member, SHARE_AHEAD, bytes);
    user_give(&client->member, SHARE_AHEAD, item->started_bytes);
    item->started_bytes = bytes;
}

void item_enter(struct item *item, enum item_state state)
{
    assert(may_follow[item->state] & 1u << state);
    item->state = state;
    set_started(item, state == ITEM_WAITING || state == ITEM_ANSWERED ? 0 : item->memory.claim.bytes);
    item->request->open -= state == ITEM_ANSWERED;
}

struct preparation *item_take_preparation(struct item *item)
{
    struct preparation *preparation = item->preparation;
    item->preparation = NULL;
    return preparation;
}

/* ---- results ---- */

static void answer(struct item *item, struct control_result *result, struct blob *blob)
{
    struct request *request = item->request;
    if (request->client->gone)
        return;
    double total = (double)(clock_ns() - request->arrived_ns) * 1e-6;
    double rest = total - item->times.prepare_ms - item->times.build_ms;
    result->item = item->index;
    result->prepare_ms = item->times.prepare_ms;
    result->build_ms = item->times.build_ms;
    result->queued_ms = rest > 0 ? rest : 0;
    item_report(item, result);
    request->client->events->result(request->client, request, result, blob);
}

static void answer_error(struct item *item, const struct bvhd_error *error)
{
    const struct request *request = item->request;
    bool is_ours = error->status == BVHD_INTERNAL || error->status == BVHD_IO;
    uint32_t suppressed;
    if (is_ours && log_limit_pass(&request->client->service->failed_log, &suppressed))
        log_event(error->status == BVHD_INTERNAL ? LOG_ERROR : LOG_WARNING, "item_failed",
                  PEER_FORMAT " request=%llu item=%u status=%s why=%s suppressed=%u",
                  PEER_VALUES(&request->client->peer), (unsigned long long)request->number, item->index,
                  bvhd_status_name(error->status), log_quote(error->text).text, suppressed);
    struct control_result result = {.error = *error};
    answer(item, &result, NULL);
}

static void answer_unknown(struct item *item)
{
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_NOT_FOUND, place("keys[%u]", item->index).text, "no structure of this key is known");
    answer_error(item, &error);
}

static void answer_blob(struct item *item, struct blob *blob, enum result_origin origin)
{
    struct control_result result = {.key = blob->key, .size = blob->size, .origin = origin, .summary = blob->summary};
    answer(item, &result, blob);
}

void item_refuse(struct item *item, const struct bvhd_error *error)
{
    item_enter(item, ITEM_ANSWERED);
    preparation_drop_source(&item->source);
    if (item->request->is_build)
        item_note_prepared(item);
    answer_error(item, error);
}

void item_fail(struct item *item, const struct bvhd_error *error)
{
    item_enter(item, ITEM_ANSWERED);
    if (!item->is_prepared && item->request->is_build)
        item_note_prepared(item);
    answer_error(item, error);
}

/* ---- the cache and flights ---- */

static struct item *item_of_waiter(struct flight_waiter *waiter)
{
    return container_of(waiter, struct item, waiter);
}

static void add_times(struct item *item, const struct flight_completion *completion)
{
    const struct flight_times *flight = &completion->times;
    struct item_times *times = &item->times;
    times->waiters = completion->first ? completion->waiters : 0;
    if (completion->origin != ORIGIN_BUILT && !(completion->origin == ORIGIN_DISK && completion->first))
        return;
    times->memory_ms += flight->memory_ms;
    times->threads_ms += flight->threads_ms;
    times->disk_ms = flight->disk_ms;
    times->build_ms = flight->build_ms;
    times->repeated_ms = flight->repeated_ms;
}

static void completed(struct flight_waiter *waiter, const struct flight_completion *completion)
{
    struct item *item = item_of_waiter(waiter);
    item_enter(item, ITEM_ANSWERED);
    add_times(item, completion);
    if (completion->blob)
        answer_blob(item, completion->blob, completion->origin);
    else if (completion->error->status == BVHD_NOT_FOUND)
        answer_unknown(item);
    else
        answer_error(item, completion->error);
    request_settle(item->request);
}

static struct flight_waiter *waiter_of(struct item *item)
{
    struct request *request = item->request;
    item->waiter = (struct flight_waiter){
        .completed = completed, .client = &request->client->member, .priority = request->priority};
    return &item->waiter;
}

/*
 * Answers with the blob that the cache had, or joins the flight of the key, which takes over the preparation of an item
 * of BUILD. Returns false if there is neither.
 */
static bool answer_or_join(struct item *item, struct blob *blob)
{
    struct service *service = item_service(item);
    struct flight *flight = blob ? NULL : flights_find(&service->flights, &item->key);
    if (blob) {
        item_enter(item, ITEM_ANSWERED);
        service->counters.hits_memory++;
        disposals_add(&service->disposals, item_take_preparation(item));
        answer_blob(item, blob, ORIGIN_MEMORY);
    } else if (flight) {
        item_enter(item, ITEM_JOINED);
        flight_join(flight, item_take_preparation(item), waiter_of(item));
    }
    return blob || flight;
}

static void start_flight(struct item *item)
{
    struct service *service = item_service(item);
    struct bvhd_error error;
    enum bvhd_status status =
        flights_start(&service->flights, &item->key, item_take_preparation(item), waiter_of(item), &error);
    if (status == BVHD_OK)
        item_enter(item, ITEM_JOINED);
    else
        item_fail(item, &error);
}

static void was_looked_up(void *context, struct blob *blob)
{
    struct item *item = context;
    if (!answer_or_join(item, blob))
        start_flight(item);
}

void item_find_result(struct item *item)
{
    cache_get(item_service(item)->cache, &item->key, was_looked_up, item);
}

/* ---- GET ---- */

/* It needs no memory of the budget, only its turn. */
static void start_lookup(struct memory_waiter *waiter)
{
    struct item *item = container_of(waiter, struct item, memory);
    struct request *request = item->request;
    admission_end(&item_service(item)->admission.prepares[waiter->claim.class], waiter->claim.bytes);
    item->times.memory_ms += (double)(clock_ns() - item->times.queued_ns) * 1e-6;
    item_find_result(item);
    request_settle(request);
}

/*
 * A lookup on disk waits like a prepare, so that it does not start while the client is too far behind with reading its
 * results: a small request may name keys of large ones. Their sizes are not known until they are read.
 */
static void wait_for_lookup(struct item *item)
{
    enum { GUESS = 1 << 20 };
    item->memory = (struct memory_waiter){.start = start_lookup,
                                          .claim = {.bytes = GUESS, .class = ADMISSION_SMALL},
                                          .priority = item->request->priority};
    item_enter(item, ITEM_WAITING);
    item->times.queued_ns = clock_ns();
    memory_queue_add(&item_service(item)->preparing, &item->request->client->member.preparing, &item->memory);
}

static void get_was_looked_up(void *context, struct blob *blob)
{
    struct item *item = context;
    struct service *service = item_service(item);
    if (answer_or_join(item, blob))
        return;
    if (service->flights.disk) {
        wait_for_lookup(item);
        return;
    }
    service->counters.misses++;
    item_enter(item, ITEM_ANSWERED);
    answer_unknown(item);
}

void item_get(struct item *item, const struct key *key)
{
    item->key = *key;
    cache_get(item_service(item)->cache, key, get_was_looked_up, item);
}

/* ---- cancellation ---- */

/* Takes the item out of queues and flights. If a worker has it, it only tells the worker to stop. */
static void withdraw(struct item *item)
{
    struct service *service = item_service(item);
    switch (item->state) {
    case ITEM_WAITING:
        memory_queue_remove(&service->preparing, &item->memory);
        preparation_drop_source(&item->source);
        preparation_destroy(item_take_preparation(item));
        item_enter(item, ITEM_ANSWERED);
        if (item->request->is_build)
            item_note_prepared(item);
        break;
    case ITEM_PREPARING:
        item_enter(item, ITEM_LEAVING);
        pool_cancel(service->pool, &item->job);
        break;
    default:
        flight_leave(&service->flights, &item->waiter);
        item_enter(item, ITEM_ANSWERED);
    }
}

void item_withdraw(struct item *item, const struct bvhd_error *error)
{
    if (item->state == ITEM_LEAVING || item->state == ITEM_ANSWERED)
        return;
    withdraw(item);
    item_service(item)->counters.cancelled++;
    answer_error(item, error);
}

void item_cancel(struct item *item)
{
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_CANCELLED, "", "cancelled");
    item_withdraw(item, &error);
}
