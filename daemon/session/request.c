/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/session/request.h"

#include <assert.h>

#include "daemon/session/item_internal.h"
#include "daemon/system/log.h"
#include "proto/base/clock.h"
#include "proto/base/container_of.h"

/* ---- the end ---- */

static void log_end(const struct request *request)
{
    log_event(LOG_DEBUG, "request_done", PEER_FORMAT " request=%llu kind=%s items=%u ms=%.3f",
              PEER_VALUES(&request->client->peer), (unsigned long long)request->number,
              request->is_build ? "build" : "get", request->count, (double)(clock_ns() - request->arrived_ns) * 1e-6);
}

void request_settle(struct request *request)
{
    struct request_client *client = request->client;
    struct memory *memory = &client->service->memory;
    if (request->open > 0 || (request->unreported > 0 && !client->gone))
        return;
    if (request->to_report > 0)
        deferred_cancel(&client->service->deferred, &request->report);
    log_end(request);
    client->events->ended(client, request);
    memory_free(memory, request->destinations);
    memory_free(memory, request);
}

void request_cancel(struct request *request)
{
    for (uint32_t i = 0; i < request->count; i++)
        item_cancel(&request->items[i]);
    request_settle(request);
}

void request_expire(struct request *request)
{
    struct bvhd_error error;
    bvhd_error_deadline(&error, request->deadline_ms);
    for (uint32_t i = 0; i < request->count; i++)
        item_withdraw(&request->items[i], &error);
    request_settle(request);
}

/* ---- reports of prepared payloads ---- */

void item_note_prepared(struct item *item)
{
    struct request *request = item->request;
    struct request_client *client = request->client;
    assert(!item->is_prepared);
    item->is_prepared = true;
    if (--request->unprepared == 0)
        user_give(&client->member, SHARE_INLINE, request->inline_bytes);
    if (item->pooled)
        client->events->pool_released(client);
    if (request->to_report++ == 0)
        deferred_add(&client->service->deferred, &request->report);
}

/*
 * Marks the items that are reported now, and lists them. False without memory for the list: the connection ends then,
 * so the marks do not matter any more.
 */
static bool list_prepared(struct request *request, struct memory *memory, struct control_items *ret_items)
{
    struct control_items items = {0, memory_array(memory, request->to_report, sizeof *items.items)};
    for (uint32_t i = 0; i < request->count; i++) {
        struct item *item = &request->items[i];
        if (!item->is_prepared || item->is_reported)
            continue;
        item->is_reported = true;
        if (items.items)
            items.items[items.count++] = i;
    }
    if (items.items)
        *ret_items = items;
    return items.items != NULL;
}

static struct request *request_of_report(struct deferred_call *call)
{
    return container_of(call, struct request, report);
}

static void report_prepared(struct deferred_call *call)
{
    struct request *request = request_of_report(call);
    struct request_client *client = request->client;
    struct memory *memory = service_frame_memory(client->service);
    struct control_items items = {0, NULL};
    bool listed = !client->gone && list_prepared(request, memory, &items);
    request->unreported -= request->to_report;
    request->to_report = 0;
    if (!client->gone)
        client->events->prepared(client, request, listed ? &items : NULL);
    memory_free(memory, items.items);
    request_settle(request);
}

/* ---- the start ---- */

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
    request->deadline_ms = head->deadline_ms;
    request->deadline_ns = head->deadline_ms > 0 ? request->arrived_ns + (uint64_t)head->deadline_ms * 1000000 : 0;
    request->count = request->open = head->count;
    request->unreported = request->unprepared = head->is_build ? head->count : 0;
    request->report.run = report_prepared;
    for (uint32_t i = 0; i < head->count; i++) {
        request->items[i].request = request;
        request->items[i].index = i;
    }
    return request;
}
