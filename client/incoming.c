/* SPDX-License-Identifier: Apache-2.0 */
#include "client/incoming.h"

#include <unistd.h>

#include "client/client_batch.h"
#include "client/client_deadline.h"
#include "client/client_link.h"
#include "proto/base/place.h"
#include "client/result_blob.h"

enum { MIN_RETRY_MS = 1, MAX_RETRY_MS = 2000, POOL_AGAIN_MS = 5000 };

/* One received frame. */
struct incoming_frame {
    struct bvhd_client *client;
    struct connection *connection;
    struct frame *frame;
    struct exchange *exchange; /* the exchange that it answers */
    uint64_t now;
    struct bvhd_error *error;
};

static enum bvhd_status violation(const struct incoming_frame *arrival, const char *text)
{
    return bvhd_error_set(arrival->error, BVHD_CORRUPT, place("frame type %u", arrival->frame->header.type).text,
                          "the daemon breaks the protocol: %s", text);
}

/*
 * After an answer: drops the frame's bytes, which are not needed again, or ends the exchange if this was the last
 * answer.
 */
static void settle(const struct incoming_frame *arrival)
{
    struct exchange *exchange = arrival->exchange;
    if (exchange->unanswered == 0 && exchange->unprepared == 0)
        client_link_end(arrival->client, arrival->connection, exchange);
    else
        exchange_drop_frame(exchange);
}

/*
 * From now on payloads do not use the pool, at least for a while. A refusal by the leaving daemon does not affect the
 * next one.
 */
static void refuse_pool(const struct incoming_frame *arrival, uint64_t again)
{
    arrival->connection->pool = POOL_REFUSED;
    arrival->connection->pool_again = again;
    if (arrival->connection == arrival->client->current)
        placement_refuse(&arrival->client->placement, true);
    client_stir(arrival->client);
}

static enum bvhd_status take_welcome(const struct incoming_frame *arrival)
{
    struct control_welcome *welcome;
    enum bvhd_status status =
        control_unpack_welcome(arrival->frame->control, &library_memory, &welcome, arrival->error);
    if (status != BVHD_OK)
        return status;
    status = connection_welcome(arrival->connection, welcome, arrival->error);
    memory_free(&library_memory, welcome);
    if (status != BVHD_OK)
        return status;
    placement_refuse(&arrival->client->placement, false);
    if (arrival->connection->limits.max_pool == 0)
        refuse_pool(arrival, 0);
    arrival->client->backoff_ms = 0;
    arrival->client->last_error.status = BVHD_OK;
    client_stir(arrival->client);
    return BVHD_OK;
}

/* An ERROR for the connection: the daemon ends it and says why. */
static enum bvhd_status take_last_words(const struct incoming_frame *arrival)
{
    struct bvhd_error *said;
    enum bvhd_status status = control_unpack_error(arrival->frame->control, &library_memory, &said, arrival->error);
    if (status != BVHD_OK)
        return status;
    status = said->status == BVHD_OK || said->status == BVHD_NO_MEMORY ? BVHD_UNAVAILABLE : said->status;
    bvhd_error_set(arrival->error, status, said->where[0] ? said->where : "connection",
                   "the daemon ended the connection: %s", said->text);
    memory_free(&library_memory, said);
    return status;
}

/* Replaces a place such as "infos[3]", which counts within the request, by the number within the batch. */
static void renumber(struct bvhd_error *error, const struct bvhd_batch *batch, uint32_t from, uint32_t to)
{
    const char *list = batch->keys ? "keys" : "infos";
    struct place counted = place("%s[%u]", list, from);
    size_t length = strlen(counted.text);
    if (strncmp(error->where, counted.text, length) != 0)
        return;
    struct place moved = place("%s[%u]%s", list, to, error->where + length);
    memcpy(error->where, moved.text, sizeof error->where);
}

static void fail_entry(struct exchange *exchange, uint32_t index, const struct bvhd_error *error)
{
    const struct exchange_entry *entry = &exchange->entries[index];
    if (!exchange->batch || entry->cancelled)
        return;
    struct bvhd_error told = *error;
    if (told.status == BVHD_OK || told.status == BVHD_PENDING)
        bvhd_error_set(&told, BVHD_CORRUPT, told.where, "the daemon sent an error that is none");
    if (told.status == BVHD_CANCELLED && strcmp(told.where, BVHD_ERROR_DEADLINE) == 0)
        bvhd_error_deadline(&told, exchange->batch->deadline_ms); /* the daemon knows only what was left of it */
    renumber(&told, exchange->batch, index, entry->item);
    client_batch_fail_item(exchange->batch, entry->item, &told);
}

/* Takes the bytes of a result: inline, or from the frame's descriptor. */
static enum bvhd_status take_blob(const struct incoming_frame *arrival, uint64_t size, struct bvhd_blob **ret_blob,
                                  struct bvhd_error *error)
{
    struct frame *frame = arrival->frame;
    uint32_t descriptors = frame->header.descriptors;
    if (size == 0 || descriptors > 1 || (descriptors == 1 && frame->header.inline_size > 0))
        return bvhd_error_set(error, BVHD_CORRUPT, "result", "%llu bytes in %u descriptors and %u bytes inline",
                              (unsigned long long)size, descriptors, frame->header.inline_size);
    if (descriptors == 1) {
        int descriptor = frame->descriptors[0];
        frame->descriptors[0] = -1;
        return result_blob_map(descriptor, size, arrival->connection->holdings, ret_blob, error);
    }
    if (frame->header.inline_size != size)
        return bvhd_error_set(error, BVHD_CORRUPT, "result", "%u bytes instead of %llu", frame->header.inline_size,
                              (unsigned long long)size);
    return result_blob_copy_into(frame->inline_bytes, &arrival->exchange->batch->blocks, ret_blob, error);
}

static void deliver(const struct incoming_frame *arrival, const struct control_result *result)
{
    struct exchange *exchange = arrival->exchange;
    struct exchange_entry *entry = &exchange->entries[result->item];
    struct bvhd_error error = result->error;
    struct bvhd_blob *blob;
    if (!exchange->batch || entry->cancelled) {
        connection_decline(arrival->connection, arrival->frame->header.descriptors > 0 ? result->size : 0);
        return;
    }
    if (error.status == BVHD_OK && take_blob(arrival, result->size, &blob, &error) == BVHD_OK)
        client_batch_complete_item(exchange->batch, entry->item, result, blob);
    else
        fail_entry(exchange, result->item, &error);
}

static enum bvhd_status take_result(const struct incoming_frame *arrival)
{
    struct exchange *exchange = arrival->exchange;
    if (exchange->count == 0)
        return violation(arrival, "a result of what has none");
    struct control_result *result;
    enum bvhd_status status = control_unpack_result(arrival->frame->control, &library_memory, &result, arrival->error);
    if (status != BVHD_OK)
        return status;
    if (result->item >= exchange->count || exchange->entries[result->item].answered) {
        memory_free(&library_memory, result);
        return violation(arrival, "a result of no item, or a second one");
    }
    deliver(arrival, result);
    exchange->entries[result->item].answered = true;
    exchange->unanswered--;
    arrival->connection->credits++;
    memory_free(&library_memory, result);
    settle(arrival);
    return BVHD_OK;
}

static enum bvhd_status mark_prepared(const struct incoming_frame *arrival, const struct control_items *items)
{
    struct exchange *exchange = arrival->exchange;
    for (uint32_t i = 0; i < items->count; i++) {
        uint32_t item = items->items[i];
        if (item >= exchange->count || exchange->entries[item].prepared)
            return violation(arrival, "no such item is to be prepared");
        exchange->entries[item].prepared = true;
        exchange->unprepared--;
        placement_release(&arrival->client->placement, &exchange->entries[item].held);
    }
    return BVHD_OK;
}

static enum bvhd_status take_prepared(const struct incoming_frame *arrival)
{
    if (arrival->exchange->type != FRAME_BUILD)
        return violation(arrival, "nothing is to be prepared");
    struct control_items *items;
    enum bvhd_status status = control_unpack_items(arrival->frame->control, &library_memory, &items, arrival->error);
    if (status != BVHD_OK)
        return status;
    status = mark_prepared(arrival, items);
    memory_free(&library_memory, items);
    if (status == BVHD_OK)
        settle(arrival);
    return status;
}

static enum bvhd_status note_progress(const struct incoming_frame *arrival, const struct control_progress *progress)
{
    struct exchange *exchange = arrival->exchange;
    for (uint32_t i = 0; i < progress->count; i++) {
        if (progress->items[i] >= exchange->count)
            return violation(arrival, "progress of no item");
        const struct exchange_entry *entry = &exchange->entries[progress->items[i]];
        if (exchange->batch && !entry->cancelled)
            client_batch_set_progress(exchange->batch, entry->item, progress->thousandths[i]);
    }
    return BVHD_OK;
}

static enum bvhd_status take_progress(const struct incoming_frame *arrival)
{
    struct control_progress *progress;
    if (arrival->exchange->count == 0)
        return violation(arrival, "progress of what has no items");
    enum bvhd_status status =
        control_unpack_progress(arrival->frame->control, &library_memory, &progress, arrival->error);
    if (status != BVHD_OK)
        return status;
    status = note_progress(arrival, progress);
    memory_free(&library_memory, progress);
    return status;
}

static void answer_waiter(const struct exchange *exchange, const struct bvhd_error *error)
{
    if (!exchange->waiter)
        return;
    exchange->waiter->error = *error;
    exchange->waiter->done = true;
}

/* An ERROR for a request: it failed as a whole, and no more answers come. */
static enum bvhd_status take_error(const struct incoming_frame *arrival)
{
    struct exchange *exchange = arrival->exchange;
    struct bvhd_error *said;
    enum bvhd_status status = control_unpack_error(arrival->frame->control, &library_memory, &said, arrival->error);
    if (status != BVHD_OK)
        return status;
    for (uint32_t i = 0; i < exchange->count; i++)
        if (!exchange->entries[i].answered)
            fail_entry(exchange, i, said);
    if (exchange->type == FRAME_POOL)
        refuse_pool(arrival, arrival->now + POOL_AGAIN_MS * LIBRARY_MS);
    answer_waiter(exchange, said);
    memory_free(&library_memory, said);
    arrival->connection->credits += exchange->unanswered;
    client_link_end(arrival->client, arrival->connection, exchange);
    client_stir(arrival->client);
    return BVHD_OK;
}

/* Returns a moment after 1 to 1.5 times the daemon's delay, so that clients do not all come back at once. */
static uint64_t retry_moment(struct bvhd_client *client, uint32_t retry_ms, uint64_t now)
{
    uint32_t ms = retry_ms < MIN_RETRY_MS ? MIN_RETRY_MS : retry_ms > MAX_RETRY_MS ? MAX_RETRY_MS : retry_ms;
    client->random = client->random * 1664525 + 1013904223;
    return now + ms * LIBRARY_MS + (ms * LIBRARY_MS / 2 >> 16) * (client->random >> 16);
}

static enum bvhd_status take_busy(const struct incoming_frame *arrival)
{
    struct exchange *exchange = arrival->exchange;
    struct control_busy *busy;
    if (exchange->count > 0 && (exchange->unanswered < exchange->count || exchange_is_prepared(exchange)))
        return violation(arrival, "a request that was taken cannot be refused");
    enum bvhd_status status = control_unpack_busy(arrival->frame->control, &library_memory, &busy, arrival->error);
    if (status != BVHD_OK)
        return status;
    uint64_t until = retry_moment(arrival->client, busy->retry_ms, arrival->now);
    memory_free(&library_memory, busy);
    if (exchange->type == FRAME_POOL) {
        refuse_pool(arrival, arrival->now + POOL_AGAIN_MS * LIBRARY_MS);
        client_link_end(arrival->client, arrival->connection, exchange);
    } else {
        connection_park(arrival->connection, exchange, until);
    }
    return BVHD_OK;
}

static enum bvhd_status take_done(const struct incoming_frame *arrival)
{
    if (arrival->exchange->type != FRAME_POOL)
        return violation(arrival, "DONE for what is no POOL");
    arrival->connection->pool = POOL_READY;
    client_link_end(arrival->client, arrival->connection, arrival->exchange);
    return BVHD_OK;
}

/* Ends an exchange that a thread waits for. */
static void end_call(const struct incoming_frame *arrival, const struct bvhd_error *error)
{
    answer_waiter(arrival->exchange, error);
    client_link_end(arrival->client, arrival->connection, arrival->exchange);
    client_stir(arrival->client);
}

static enum bvhd_status take_pong(const struct incoming_frame *arrival)
{
    if (arrival->exchange->type != FRAME_PING)
        return violation(arrival, "PONG for what is no PING");
    end_call(arrival, &(struct bvhd_error){.status = BVHD_OK});
    return BVHD_OK;
}

static enum bvhd_status take_counters(const struct incoming_frame *arrival)
{
    struct exchange_waiter *waiter = arrival->exchange->waiter;
    if (arrival->exchange->type != FRAME_STATS)
        return violation(arrival, "counters that nobody asked for");
    struct control_counters *message;
    enum bvhd_status status =
        control_unpack_counters(arrival->frame->control, &library_memory, &message, arrival->error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_counters *counters = counter_list_create(message);
    struct bvhd_error result = {.status = BVHD_OK};
    if (!counters)
        bvhd_error_no_memory(&result, "counters", "no memory for them");
    if (waiter)
        waiter->counters = counters;
    else
        bvhd_counters_destroy(counters);
    end_call(arrival, &result);
    return BVHD_OK;
}

static enum bvhd_status take_client_list(const struct incoming_frame *arrival)
{
    struct exchange_waiter *waiter = arrival->exchange->waiter;
    if (arrival->exchange->type != FRAME_CLIENTS)
        return violation(arrival, "a list of clients that nobody asked for");
    struct control_client_list *message;
    enum bvhd_status status =
        control_unpack_client_list(arrival->frame->control, &library_memory, &message, arrival->error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_connections *connections = connection_list_create(message);
    struct bvhd_error result = {.status = BVHD_OK};
    if (!connections)
        bvhd_error_no_memory(&result, "connections", "no memory for them");
    if (waiter)
        waiter->connections = connections;
    else
        bvhd_connections_destroy(connections);
    end_call(arrival, &result);
    return BVHD_OK;
}

static enum bvhd_status take_cache_state(const struct incoming_frame *arrival)
{
    struct exchange_waiter *waiter = arrival->exchange->waiter;
    if (arrival->exchange->type != FRAME_CACHE)
        return violation(arrival, "a state of caches that nobody asked for");
    struct control_cache_state *message;
    enum bvhd_status status =
        control_unpack_cache_state(arrival->frame->control, &library_memory, &message, arrival->error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_cache_state *cache = cache_state_create(message);
    struct bvhd_error result = {.status = BVHD_OK};
    if (!cache)
        bvhd_error_no_memory(&result, "cache", "no memory for its state");
    if (waiter)
        waiter->cache = cache;
    else
        bvhd_cache_state_destroy(cache);
    end_call(arrival, &result);
    return BVHD_OK;
}

/* Handles frames about the connection itself. */
static enum bvhd_status take_connection_frame(const struct incoming_frame *arrival)
{
    bool is_hello = arrival->connection->state == CONNECTION_HELLO;
    switch (arrival->frame->header.type) {
    case FRAME_WELCOME:
        return is_hello ? take_welcome(arrival) : violation(arrival, "a second WELCOME");
    case FRAME_ERROR:
        return take_last_words(arrival);
    case FRAME_GOODBYE:
        if (is_hello)
            return bvhd_error_set(arrival->error, BVHD_UNAVAILABLE, "connection", "the daemon is about to end");
        client_link_leave(arrival->client, arrival->connection, arrival->now);
        return BVHD_OK;
    default:
        return violation(arrival, "it belongs to no request");
    }
}

static enum bvhd_status take_answer(struct incoming_frame *arrival)
{
    if (arrival->connection->state == CONNECTION_HELLO)
        return violation(arrival, "an answer before WELCOME");
    arrival->exchange = exchange_table_find(&arrival->connection->table, arrival->frame->header.request);
    if (!arrival->exchange || !arrival->exchange->on_wire)
        return violation(arrival, "an answer to no request");
    switch (arrival->frame->header.type) {
    case FRAME_DONE:
        return take_done(arrival);
    case FRAME_ERROR:
        return take_error(arrival);
    case FRAME_BUSY:
        return take_busy(arrival);
    case FRAME_PREPARED:
        return take_prepared(arrival);
    case FRAME_RESULT:
        return take_result(arrival);
    case FRAME_COUNTERS:
        return take_counters(arrival);
    case FRAME_PONG:
        return take_pong(arrival);
    case FRAME_PROGRESS:
        return take_progress(arrival);
    case FRAME_CACHE_STATE:
        return take_cache_state(arrival);
    case FRAME_CLIENT_LIST:
        return take_client_list(arrival);
    default:
        return violation(arrival, "it answers nothing");
    }
}

static enum bvhd_status handle(void *context, struct connection *connection, struct frame *frame,
                               struct bvhd_error *error)
{
    struct incoming_frame arrival = {context, connection, frame, NULL, connection->heard_at, error};
    enum bvhd_status status = BVHD_OK;
    uint16_t type = frame->header.type;
    if (type < FRAME_WELCOME)
        status = violation(&arrival, "only clients send it");
    else if (type <= FRAME_CLIENT_LIST) /* unknown types are ignored: later versions may send them */
        status = frame->header.request == 0 ? take_connection_frame(&arrival) : take_answer(&arrival);
    for (uint32_t i = 0; i < frame->header.descriptors; i++)
        if (frame->descriptors[i] >= 0)
            close(frame->descriptors[i]);
    return status;
}

static void receive(struct bvhd_client *client, struct connection *connection, uint64_t now)
{
    struct bvhd_error error;
    if (!connection)
        return;
    enum bvhd_status status = connection_receive(connection, handle, client, now, &error);
    if (status == BVHD_OK && (connection->is_blocked || connection->is_starved))
        status = connection_flush(connection, &error);
    if (status != BVHD_OK)
        client_link_lose(client, connection, &error);
}

void incoming_receive(struct bvhd_client *client, uint64_t now)
{
    receive(client, client->leaving, now);
    receive(client, client->current, now);
    client_link_tidy(client);
}
