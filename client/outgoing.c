/* SPDX-License-Identifier: Apache-2.0 */
#include "client/outgoing.h"

#include "client/client_batch.h"
#include "client/client_deadline.h"
#include "client/client_link.h"
#include "client/incoming.h"
#include "proto/base/place.h"
#include "proto/wire/rows.h"

enum {
    /*
     * Payloads up to this size travel inside frames. For larger ones, the copy that the pool saves costs more than the
     * use of the pool.
     */
    INLINE_MAX = 16 * 1024,
    ITEM_CONTROL = 160, /* upper bound of the bytes of a control message for one item */
    FRAME_ITEMS = 256, /* more items in one frame save nothing */
    FIRST_FRAME_BYTES = 128 << 10, /* small, so that the daemon can start while the rest is copied */
    LAST_FRAME_BYTES = 1 << 20,
};

/* A frame that is being made. */
struct draft {
    struct bvhd_client *client;
    struct connection *connection;
    struct bvhd_batch *batch;
    struct exchange *exchange;
    struct control_item *items; /* of a BUILD */
    struct key *keys; /* of a GET */
    uint32_t capacity;
    uint64_t bytes; /* payload bytes so far */
    unsigned char *inline_bytes; /* NULL: none yet */
    uint64_t inline_size, inline_capacity;
    uint64_t memfd_sizes[FRAME_MAX_DESCRIPTORS];
};

/* The outcome of adding an item to a frame. */
enum added { ADDED, NO_ROOM, FAILED };

static enum added fail(struct bvhd_batch *batch, uint32_t index, enum bvhd_status status, const char *text)
{
    struct bvhd_error error;
    bvhd_error_set(&error, status, place("infos[%u]", index).text, "%s", text);
    client_batch_fail_item(batch, index, &error);
    return FAILED;
}

static const struct build_input *input_of(const struct bvhd_batch *batch, uint32_t index)
{
    return &vulkan_input_entries(batch->input)[index];
}

/* Copies an item's payload into the client's memory. */
static enum added copy_item(struct bvhd_batch *batch, uint32_t index, uint64_t size)
{
    struct bvhd_error error;
    enum bvhd_status status = BVHD_OK;
    if (size > 0)
        status =
            placement_take(&batch->client->placement, input_of(batch, index), size, &batch->items[index].held, &error);
    if (status == BVHD_BUSY)
        return NO_ROOM;
    if (status != BVHD_OK)
        return fail(batch, index, status, error.text);
    client_batch_set_copied(batch, index);
    return ADDED;
}

static bool fits_inline(const struct draft *draft, uint64_t size)
{
    return size <= draft->connection->limits.max_inline - draft->inline_size;
}

/* Returns space for `size` more inline bytes, which fit into the frame; NULL without memory. */
static unsigned char *inline_space(struct draft *draft, uint64_t size)
{
    uint64_t needed = draft->inline_size + size, most = draft->connection->limits.max_inline;
    if (needed > draft->inline_capacity) {
        uint64_t twice = 2 * draft->inline_capacity, capacity = needed > twice ? needed : twice < most ? twice : most;
        unsigned char *bytes = memory_resize(&library_memory, draft->inline_bytes, capacity);
        if (!bytes)
            return NULL;
        draft->inline_bytes = bytes;
        draft->inline_capacity = capacity;
    }
    unsigned char *space = draft->inline_bytes + draft->inline_size;
    draft->inline_size = needed;
    return space;
}

/* Writes a payload into the frame, from the caller's memory or from the pool. */
static enum added put_inline(struct draft *draft, uint32_t index, uint64_t size)
{
    struct client_item *item = &draft->batch->items[index];
    unsigned char *space = size > 0 ? inline_space(draft, size) : NULL;
    if (size > 0 && !space)
        return fail(draft->batch, index, BVHD_NO_MEMORY, "no memory for a frame");
    if (space && item->state == ITEM_WAITING)
        rows_write(input_of(draft->batch, index), space);
    else if (space)
        memcpy(space, placement_bytes(&draft->client->placement, &item->held), size);
    placement_release(&draft->client->placement, &item->held);
    if (item->state == ITEM_WAITING)
        client_batch_set_copied(draft->batch, index);
    return ADDED;
}

/*
 * Adapts the pool to the daemon's limits: makes it smaller if necessary, and offers a refused one again after a while.
 */
static void adapt_pool(struct bvhd_client *client, struct connection *connection)
{
    if (connection->pool == POOL_REFUSED && connection->pool_again && clock_ns() >= connection->pool_again) {
        connection->pool = POOL_UNASKED;
        placement_refuse(&client->placement, false);
    }
    /* The descriptor for the leaving daemon may not have been sent yet. */
    bool is_lent = client->leaving && client->leaving->pool == POOL_ASKED;
    if (connection->pool == POOL_UNASKED && !is_lent)
        placement_limit(&client->placement, connection->limits.max_pool);
}

static void ask_for_pool(struct draft *draft)
{
    struct connection *connection = draft->connection;
    struct placement *placement = &draft->client->placement;
    struct control_pool pool = {placement->pool_size};
    struct exchange *exchange = exchange_create(FRAME_POOL, 0);
    if (!exchange)
        return;
    exchange->descriptors[0] = placement->descriptor;
    exchange->descriptor_count = 1;
    if (control_pack_pool(&pool, &library_memory, &exchange->control, NULL) == BVHD_OK &&
        connection_send(connection, exchange, clock_ns()))
        connection->pool = POOL_ASKED;
    else
        exchange_destroy(exchange);
}

/* Decides how a payload in the pool can be sent: as it is, later, or outside of the pool. */
static enum added make_pool_usable(struct draft *draft, uint32_t index, uint64_t size)
{
    struct connection *connection = draft->connection;
    struct bvhd_error error;
    if (connection->pool == POOL_UNASKED && draft->client->placement.pool_size <= connection->limits.max_pool)
        ask_for_pool(draft);
    if (connection->pool == POOL_READY)
        return ADDED;
    if (connection->pool == POOL_ASKED)
        return NO_ROOM;
    if (fits_inline(draft, size))
        return put_inline(draft, index, size);
    if (size <= connection->limits.max_inline)
        return NO_ROOM; /* the next frame has room */
    enum bvhd_status status = placement_move_out(&draft->client->placement, &draft->batch->items[index].held, &error);
    return status == BVHD_OK ? ADDED : status == BVHD_BUSY ? NO_ROOM : fail(draft->batch, index, status, error.text);
}

/* Brings an item's payload to a place that the frame can name. */
static enum added place_item(struct draft *draft, uint32_t index, uint64_t size)
{
    struct client_item *item = &draft->batch->items[index];
    if (size <= INLINE_MAX && item->held.kind != HELD_MEMFD && fits_inline(draft, size))
        return put_inline(draft, index, size);
    enum added added = item->state == ITEM_WAITING ? copy_item(draft->batch, index, size) : ADDED;
    if (added == ADDED && item->held.kind == HELD_POOL)
        added = make_pool_usable(draft, index, size);
    if (added == ADDED && item->held.kind == HELD_MEMFD && draft->exchange->descriptor_count == FRAME_MAX_DESCRIPTORS)
        added = NO_ROOM; /* the next frame has room */
    return added;
}

/*
 * Returns rays_per_primitive, or 0 if the quality does not depend on it: an older daemon refuses a hint that it does
 * not know.
 */
static float rays_hint(const struct build_options *options)
{
    bool decides = options->quality == QUALITY_AUTO || options->quality == QUALITY_UNSPECIFIED;
    return decides ? options->rays_per_primitive : 0;
}

struct control_item outgoing_describe(const struct build_input *input)
{
    return (struct control_item){
        .type = input->type,
        .flags = input->flags,
        .mode = input->mode,
        .destination = input->destination,
        .source = input->source,
        .source_key = input->source_key,
        .quality = input->options.quality,
        .target = input->options.target,
        .layout_flags = input->options.layout_flags,
        .geometry_count = input->geometry_count,
        .geometry_size = rows_geometry_size(input),
        .reference_count = input->reference_count,
        .reference_size = sizeof(struct reference_row),
        .device = input->options.device,
        .rays_per_primitive = rays_hint(&input->options),
        .builder = input->options.builder,
    };
}

static void name_payload(struct draft *draft, const struct held *held, uint64_t size, struct control_item *item)
{
    struct exchange *exchange = draft->exchange;
    item->payload_size = size;
    if (held->kind == HELD_POOL) {
        item->payload_source = SOURCE_POOL;
        item->payload_offset = held->offset;
    } else if (held->kind == HELD_MEMFD) {
        item->payload_source = SOURCE_MEMFD;
        item->memfd = exchange->descriptor_count;
        draft->memfd_sizes[exchange->descriptor_count] = size;
        exchange->descriptors[exchange->descriptor_count++] = held->descriptor;
    } else {
        item->payload_source = SOURCE_INLINE;
        item->payload_offset = draft->inline_size - size;
    }
}

static enum added add_build(struct draft *draft, uint32_t index)
{
    struct bvhd_batch *batch = draft->batch;
    const struct build_input *input = input_of(batch, index);
    uint64_t size;
    if (!rows_payload_size(input, &size) || size > draft->connection->limits.max_payload)
        return fail(batch, index, BVHD_TOO_LARGE, "more bytes than the daemon takes");
    if (input->options.builder != BUILDER_OWN && !draft->connection->limits.has_builders)
        return fail(batch, index, BVHD_UNSUPPORTED, "the daemon's version has no builder but its own");
    if (!key_is_zero(&input->source_key) && !draft->connection->limits.has_updates)
        return fail(batch, index, BVHD_UNSUPPORTED, "the daemon's version does not update structures");
    enum added added = place_item(draft, index, size);
    if (added != ADDED)
        return added;
    struct control_item *item = &draft->items[draft->exchange->count];
    *item = outgoing_describe(input);
    name_payload(draft, &batch->items[index].held, size, item);
    draft->bytes += size;
    return ADDED;
}

static enum added add_key(struct draft *draft, uint32_t index)
{
    draft->keys[draft->exchange->count] = draft->batch->keys[index];
    return ADDED;
}

static void add_items(struct draft *draft)
{
    struct bvhd_batch *batch = draft->batch;
    struct exchange *exchange = draft->exchange;
    for (uint32_t i = batch->first_unsent; i < batch->count && exchange->count < draft->capacity; i++) {
        if (batch->items[i].state == ITEM_BLOCKED || batch->items[i].state >= ITEM_SENT)
            continue;
        enum added added = batch->keys ? add_key(draft, i) : add_build(draft, i);
        if (added == NO_ROOM)
            break;
        if (added == ADDED)
            exchange->entries[exchange->count++] = (struct exchange_entry){.item = i, .held = {.descriptor = -1}};
        if (draft->bytes >= batch->frame_bytes)
            break;
    }
}

static enum bvhd_status pack(struct draft *draft, struct bytes *ret_control)
{
    struct exchange *exchange = draft->exchange;
    if (draft->batch->keys) {
        struct control_get get = {.key_count = exchange->count, .keys = draft->keys};
        return control_pack_get(&get, &library_memory, ret_control, NULL);
    }
    struct control_build build = {
        .priority = draft->batch->priority,
        .deadline_ms = client_deadline_left_ms(draft->batch, clock_ns()),
        .memfd_count = exchange->descriptor_count,
        .item_count = exchange->count,
        .items = draft->items,
    };
    memcpy(build.memfd_sizes, draft->memfd_sizes, sizeof build.memfd_sizes);
    return control_pack_build(&build, &library_memory, ret_control, NULL);
}

/* Fails the items of a frame that could not be made. */
static void fail_draft(struct draft *draft)
{
    for (uint32_t i = 0; i < draft->exchange->count; i++)
        fail(draft->batch, draft->exchange->entries[i].item, BVHD_NO_MEMORY, "no memory for a request");
}

/* After a frame is queued: its payloads belong to the exchange now. */
static void hand_over(struct draft *draft)
{
    struct exchange *exchange = draft->exchange;
    for (uint32_t i = 0; i < exchange->count; i++) {
        struct client_item *item = &draft->batch->items[exchange->entries[i].item];
        exchange->entries[i].held = item->held;
        item->held = (struct held){.kind = HELD_NOTHING, .descriptor = -1};
        item->state = ITEM_SENT;
        item->exchange = exchange;
        item->entry = i;
    }
    exchange->batch = draft->batch;
    exchange->unanswered = exchange->count;
    exchange->unprepared = exchange->type == FRAME_BUILD ? exchange->count : 0;
    draft->batch->exchanges++;
    draft->connection->credits -= exchange->count;
    if (draft->batch->frame_bytes < LAST_FRAME_BYTES)
        draft->batch->frame_bytes *= 2;
}

/* Returns false if there is nothing to send, or no memory for it. */
static bool send_draft(struct draft *draft)
{
    struct exchange *exchange = draft->exchange;
    if (exchange->count == 0)
        return false;
    bool sent = pack(draft, &exchange->control) == BVHD_OK;
    if (sent) {
        exchange->inline_bytes = (struct bytes){draft->inline_bytes, draft->inline_size};
        draft->inline_bytes = NULL;
        sent = connection_send(draft->connection, exchange, clock_ns());
    }
    if (sent)
        hand_over(draft);
    else
        fail_draft(draft);
    return sent;
}

static uint32_t frame_capacity(const struct bvhd_batch *batch, const struct connection *connection)
{
    uint32_t by_control = connection->limits.max_control / ITEM_CONTROL, capacity = batch->count - batch->first_unsent;
    const uint32_t limits[] = {connection->credits, connection->limits.max_items, by_control ? by_control : 1,
                               FRAME_ITEMS};
    for (size_t i = 0; i < sizeof limits / sizeof limits[0]; i++)
        capacity = limits[i] < capacity ? limits[i] : capacity;
    return capacity;
}

/*
 * Sends one frame with as many items as fit. If the frame cannot be made, these items fail. Returns whether something
 * was sent.
 */
static bool send_frame(struct bvhd_batch *batch, struct connection *connection)
{
    struct draft draft = {.client = batch->client, .connection = connection, .batch = batch};
    draft.capacity = frame_capacity(batch, connection);
    if (draft.capacity == 0)
        return false;
    draft.exchange = exchange_create(batch->keys ? FRAME_GET : FRAME_BUILD, draft.capacity);
    if (batch->keys)
        draft.keys = memory_array(&library_memory, draft.capacity, sizeof *draft.keys);
    else
        draft.items = memory_array(&library_memory, draft.capacity, sizeof *draft.items);
    bool sent = false;
    if (draft.exchange && (draft.keys || draft.items)) {
        add_items(&draft);
        sent = send_draft(&draft);
    } else {
        struct bvhd_error error;
        bvhd_error_no_memory(&error, "batch", "no memory for a request");
        client_batch_fail_unsent(batch, &error);
    }
    if (!sent)
        exchange_destroy(draft.exchange);
    memory_free(&library_memory, draft.inline_bytes);
    memory_free(&library_memory, draft.items);
    memory_free(&library_memory, draft.keys);
    return sent;
}

static void skip_sent(struct bvhd_batch *batch)
{
    while (batch->first_unsent < batch->count && batch->items[batch->first_unsent].state >= ITEM_SENT)
        batch->first_unsent++;
    if (batch->first_unsent == batch->count)
        client_batch_unqueue(batch);
}

/* A blocked item at the front does not hold up the items behind it. */
static void send_batch(struct bvhd_batch *batch, struct connection *connection)
{
    if (batch->frame_bytes == 0)
        batch->frame_bytes = FIRST_FRAME_BYTES;
    skip_sent(batch);
    for (bool progress = true; progress && batch->queued;) {
        uint32_t before = batch->first_unsent;
        progress = send_frame(batch, connection);
        skip_sent(batch);
        progress = progress || batch->first_unsent != before;
    }
}

/* Sends all batches. A batch that waits for room does not hold up later batches that need none. */
static void send_queue(struct bvhd_client *client)
{
    struct connection *connection = client_link_open(client);
    if (!connection || connection->busy_until)
        return;
    adapt_pool(client, connection);
    for (struct bvhd_batch *batch = client->queue, *next; batch; batch = next) {
        next = batch->next;
        send_batch(batch, connection);
    }
}

/*
 * Copies payloads of a queue that cannot be sent yet, up to LAST_FRAME_BYTES at a time. Returns false if there is
 * nothing to copy, or no room.
 */
static bool copy_queue(struct bvhd_batch *queue)
{
    uint64_t copied = 0, size;
    bool progress = false;
    for (struct bvhd_batch *batch = queue; batch; batch = batch->next) {
        for (; batch->first_uncopied < batch->count; batch->first_uncopied++) {
            uint32_t index = batch->first_uncopied;
            if (batch->keys || batch->items[index].state != ITEM_WAITING)
                continue;
            if (copied >= LAST_FRAME_BYTES)
                return true;
            if (!rows_payload_size(input_of(batch, index), &size))
                fail(batch, index, BVHD_TOO_LARGE, "more bytes than there can be");
            else if (copy_item(batch, index, size) == NO_ROOM)
                return progress;
            else
                copied += size;
            progress = true;
        }
    }
    return progress;
}

/* Counts the entries of a parked exchange that are still wanted, and lists the others in ret_cancelled. */
static uint32_t sort_entries(const struct exchange *exchange, uint32_t *ret_cancelled)
{
    uint32_t live = 0;
    for (uint32_t i = 0; i < exchange->count; i++)
        if (exchange->entries[i].cancelled)
            ret_cancelled[i - live] = i;
        else
            live++;
    return live;
}

static void resend(struct bvhd_client *client, struct connection *connection, struct exchange *exchange)
{
    uint32_t *gone = memory_array(&library_memory, (uint64_t)exchange->count + 1, sizeof *gone);
    uint32_t live = gone ? sort_entries(exchange, gone) : exchange->count, count = exchange->count - live;
    if (live == 0 && exchange->count > 0) {
        connection->credits += exchange->unanswered;
        client_link_end(client, connection, exchange);
    } else {
        connection_resend(connection, exchange);
        if (count > 0)
            connection_cancel(connection, exchange->number, gone, count, clock_ns());
    }
    memory_free(&library_memory, gone);
}

static void resend_parked(struct bvhd_client *client, struct connection *connection)
{
    if (!connection || !connection->busy_until || clock_ns() < connection->busy_until)
        return;
    for (struct exchange *exchange = connection_unpark(connection), *next; exchange; exchange = next) {
        next = exchange->next;
        resend(client, connection, exchange);
    }
}

static void release_results(struct connection *connection)
{
    if (connection)
        connection_release(connection, clock_ns());
}

void outgoing_release(struct bvhd_client *client)
{
    release_results(client->leaving);
    release_results(client->current);
}

void outgoing_pump(struct bvhd_client *client)
{
    outgoing_release(client);
    resend_parked(client, client->leaving);
    resend_parked(client, client->current);
    send_queue(client);
    while (copy_queue(client->queue) || copy_queue(client->local.queue)) {
        client_look(client); /* WELCOME, or room, may have come meanwhile */
        send_queue(client);
    }
}

void outgoing_cancel(struct bvhd_client *client, struct exchange *exchange, const uint32_t *entries, uint32_t count)
{
    if (exchange->parked)
        return; /* the daemon has refused it, so there is nothing to cancel */
    struct connection *connections[] = {client->current, client->leaving};
    for (int i = 0; i < 2; i++)
        if (connections[i] && exchange_table_find(&connections[i]->table, exchange->number) == exchange)
            connection_cancel(connections[i], exchange->number, entries, count, clock_ns());
}
