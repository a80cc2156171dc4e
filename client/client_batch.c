/* SPDX-License-Identifier: Apache-2.0 */
#include "client/client_batch.h"

#include "client/client_deadline.h"
#include "client/client_wait.h"
#include "client/dependency.h"
#include "client/local_job.h"
#include "client/local_micromaps.h"
#include "client/outgoing.h"
#include "client/reference.h"
#include "client/result_blob.h"
#include "client/result_summary.h"

/* The result of an item that is not done. */
static const struct bvhd_result pending = {.error = {.status = BVHD_PENDING}};

struct bvhd_batch *client_batch_create(struct bvhd_client *client, uint32_t count, int32_t priority)
{
    uint64_t size;
    struct bvhd_batch *batch = NULL;
    if (bytes_mul(count, sizeof batch->items[0], &size) && bytes_add(size, sizeof *batch, &size))
        batch = memory_alloc(&library_memory, size);
    if (!batch)
        return NULL;
    *batch = (struct bvhd_batch){
        .client = client, .priority = priority, .count = count, .remaining = count, .uncopied = count};
    for (uint32_t i = 0; i < count; i++)
        batch->items[i] = (struct client_item){
            .state = ITEM_WAITING, .held = {.descriptor = -1}, .result = {.error = {.status = BVHD_PENDING}}};
    return batch;
}

struct bvhd_batch *client_batch_create_keys(struct bvhd_client *client, uint32_t count, int32_t priority)
{
    struct bvhd_batch *batch = client_batch_create(client, count, priority);
    struct key *keys = memory_array(&library_memory, (uint64_t)count + 1, sizeof *keys);
    if (!batch || !keys) {
        memory_free(&library_memory, batch);
        memory_free(&library_memory, keys);
        return NULL;
    }
    batch->keys = keys;
    batch->uncopied = 0;
    for (uint32_t i = 0; i < count; i++)
        batch->items[i].state = ITEM_COPIED; /* there is no geometry to copy */
    return batch;
}

void client_batch_set_copied(struct bvhd_batch *batch, uint32_t item)
{
    batch->items[item].state = ITEM_COPIED;
    if (!batch->items[item].is_private && --batch->uncopied == 0)
        client_stir(batch->client);
}

void client_batch_set_progress(struct bvhd_batch *batch, uint32_t index, uint32_t thousandths)
{
    struct client_item *item = &batch->items[index];
    item->thousandths = thousandths > item->thousandths ? thousandths : item->thousandths;
}

static void finish_item(struct bvhd_batch *batch, uint32_t index)
{
    struct client_item *item = &batch->items[index];
    if (item->state == ITEM_WAITING)
        client_batch_set_copied(batch, index);
    if (item->state == ITEM_SENT)
        item->exchange->entries[item->entry].cancelled = true;
    if (item->state == ITEM_BUILDING)
        local_builds_leave(item);
    placement_release(&batch->client->placement, &item->held);
    bvhd_blob_unref(item->source);
    item->source = NULL;
    local_micromaps_destroy(item->micromaps);
    item->micromaps = NULL;
    item->exchange = NULL;
    item->state = ITEM_DONE;
    dependency_settle(batch, index);
    if (--batch->remaining > 0)
        return;
    client_deadline_remove(batch);
    client_stir(batch->client);
    callback_add(batch);
}

void client_batch_fail_item(struct bvhd_batch *batch, uint32_t index, const struct bvhd_error *error)
{
    batch->items[index].result.error = *error;
    finish_item(batch, index);
}

static enum bvhd_origin origin_of(uint32_t origin)
{
    return origin <= ORIGIN_DISK ? (enum bvhd_origin)origin : BVHD_ORIGIN_NONE;
}

void client_batch_complete_item(struct bvhd_batch *batch, uint32_t index, const struct control_result *result,
                                struct bvhd_blob *blob)
{
    struct client_item *item = &batch->items[index];
    item->result = (struct bvhd_result){
        .error = {.status = BVHD_OK},
        .data = bvhd_blob_data(blob),
        .size = bvhd_blob_size(blob),
        .blob = blob,
        .origin = origin_of(result->origin),
        .queued_ms = result->queued_ms,
        .prepare_ms = result->prepare_ms,
        .build_ms = result->build_ms,
        .moves = reference_moves((struct bytes){bvhd_blob_data(blob), bvhd_blob_size(blob)}),
    };
    memcpy(item->result.key.bytes, result->key.bytes, sizeof item->result.key.bytes);
    result_summary_copy(&result->summary, &item->result);
    memcpy(item->method, result->summary.method, sizeof item->method);
    item->result.method = item->method;
    finish_item(batch, index);
}

void client_batch_share_item(struct bvhd_batch *batch, uint32_t index, const struct client_item *other)
{
    struct client_item *item = &batch->items[index];
    item->result = other->result;
    item->result.origin = BVHD_ORIGIN_MEMORY;
    item->result.queued_ms = item->result.build_ms = 0;
    item->result.prepare_ms = item->local.prepare_ms;
    memcpy(item->method, other->method, sizeof item->method);
    item->result.method = item->method;
    bvhd_blob_ref(item->result.blob);
    finish_item(batch, index);
}

static struct bvhd_batch **queue_of(const struct bvhd_batch *batch)
{
    return batch->is_local ? &batch->client->local.queue : &batch->client->queue;
}

static void unlink_batch(struct bvhd_batch *batch)
{
    struct bvhd_batch **at = queue_of(batch);
    while (batch->queued && *at != batch)
        at = &(*at)->next;
    if (batch->queued)
        *at = batch->next;
    batch->queued = false;
}

static bool goes_before(const struct bvhd_batch *batch, const struct bvhd_batch *other)
{
    return batch->priority != other->priority ? batch->priority > other->priority
                                              : batch->submitted_at <= other->submitted_at;
}

void client_batch_enqueue(struct bvhd_batch *batch, bool is_local)
{
    unlink_batch(batch);
    batch->is_local = is_local;
    struct bvhd_batch **at = queue_of(batch);
    while (*at && goes_before(*at, batch))
        at = &(*at)->next;
    batch->next = *at;
    *at = batch;
    batch->queued = true;
}

void client_batch_unqueue(struct bvhd_batch *batch)
{
    if (!batch->queued)
        return;
    unlink_batch(batch);
    vulkan_input_destroy(batch->input);
    batch->input = NULL;
}

void client_batch_fail_unsent(struct bvhd_batch *batch, const struct bvhd_error *error)
{
    client_batch_unqueue(batch);
    for (uint32_t i = batch->first_unsent; i < batch->count; i++)
        if (batch->items[i].state < ITEM_SENT)
            client_batch_fail_item(batch, i, error);
}

static struct bvhd_error cancelled(void)
{
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_CANCELLED, "", "cancelled by the program");
    return error;
}

static void cancel_exchange(struct bvhd_batch *batch, struct exchange *exchange)
{
    uint32_t interesting = 0;
    for (uint32_t i = 0; i < exchange->count; i++)
        interesting += !exchange->entries[i].answered && !exchange->entries[i].cancelled;
    if (interesting > 0)
        outgoing_cancel(batch->client, exchange, NULL, 0);
}

/* Calls `visit` for each exchange of the batch. */
static void for_exchanges(struct bvhd_batch *batch, void (*visit)(struct bvhd_batch *batch, struct exchange *exchange))
{
    struct connection *connections[] = {batch->client->current, batch->client->leaving};
    for (int c = 0; c < 2 && batch->exchanges > 0; c++)
        for (uint32_t i = 0; connections[c] && i < connections[c]->table.capacity; i++)
            if (connections[c]->table.slots[i] && connections[c]->table.slots[i]->batch == batch)
                visit(batch, connections[c]->table.slots[i]);
}

static void end_items(struct bvhd_batch *batch, const struct bvhd_error *error)
{
    if (batch->remaining == 0)
        return;
    for_exchanges(batch, cancel_exchange);
    client_batch_unqueue(batch);
    for (uint32_t i = 0; i < batch->count; i++)
        if (batch->items[i].state != ITEM_DONE)
            client_batch_fail_item(batch, i, error);
}

static void detach(struct bvhd_batch *batch, struct exchange *exchange)
{
    exchange->batch = NULL;
    batch->exchanges--;
}

/* Returns the batch that looks up bounds for this one, or NULL. */
static struct bvhd_batch *lookup_of(const struct bvhd_batch *batch)
{
    return batch->dependencies ? batch->dependencies->lookup : NULL;
}

void client_batch_end(struct bvhd_batch *batch, const struct bvhd_error *error)
{
    end_items(batch, error);
    if (lookup_of(batch))
        end_items(lookup_of(batch), error);
}

void client_batch_free(struct bvhd_batch *batch)
{
    if (!batch)
        return;
    client_batch_free(lookup_of(batch));
    dependency_destroy(batch->dependencies);
    for (uint32_t i = 0; i < batch->count; i++)
        bvhd_blob_unref(batch->items[i].result.blob);
    result_blocks_finish(&batch->blocks);
    vulkan_input_destroy(batch->input);
    memory_free(&library_memory, batch->keys);
    memory_free(&library_memory, batch);
}

/* Cancels a batch that is about to be freed, and removes all that points to it. */
static void retire(struct bvhd_batch *batch)
{
    struct bvhd_error error = cancelled();
    end_items(batch, &error);
    client_batch_unqueue(batch);
    for_exchanges(batch, detach);
    for (uint32_t i = 0; i < batch->count; i++)
        local_results_remove(&batch->client->local.results, &batch->items[i]);
}

void bvhd_batch_destroy(struct bvhd_batch *batch)
{
    if (!batch)
        return;
    struct bvhd_client *client = batch->client;
    client_lock(client);
    retire(batch);
    if (lookup_of(batch))
        retire(lookup_of(batch));
    callback_forget(batch);
    client_unlock(client);
    client_batch_free(batch); /* without the lock, since freeing large results takes time */
    client_lock(client);
    outgoing_release(client); /* at once: the program may make no more calls for a long time */
    client_unlock(client);
}

void bvhd_batch_cancel(struct bvhd_batch *batch)
{
    if (!batch)
        return;
    struct bvhd_error error = cancelled();
    client_lock(batch->client);
    client_batch_end(batch, &error);
    client_unlock(batch->client);
}

void bvhd_batch_cancel_item(struct bvhd_batch *batch, uint32_t index)
{
    if (!batch)
        return;
    client_lock(batch->client);
    if (index < batch->count && batch->items[index].state != ITEM_DONE) {
        struct client_item *item = &batch->items[index];
        struct bvhd_error error = cancelled();
        if (item->state == ITEM_SENT)
            outgoing_cancel(batch->client, item->exchange, &item->entry, 1);
        client_batch_fail_item(batch, index, &error);
        if (batch->remaining == 0)
            client_batch_unqueue(batch);
    }
    client_unlock(batch->client);
}

uint32_t bvhd_batch_count(const struct bvhd_batch *batch)
{
    return batch ? batch->count : 0;
}

float bvhd_batch_progress(struct bvhd_batch *batch, uint32_t item)
{
    float progress = 0;
    if (!batch || item >= batch->count)
        return 0;
    client_lock(batch->client);
    const struct client_item *asked = &batch->items[item];
    if (asked->state == ITEM_BUILDING)
        client_batch_set_progress(batch, item, local_job_thousandths(asked->local.job));
    if (asked->state == ITEM_DONE)
        progress = 1;
    else
        progress = (float)asked->thousandths / CONTROL_DONE;
    client_unlock(batch->client);
    return progress;
}

static bool is_copied(const void *context)
{
    const struct bvhd_batch *batch = context;
    return batch->uncopied == 0;
}

static bool is_done(const void *context)
{
    const struct bvhd_batch *batch = context;
    return batch->remaining == 0;
}

static int ask(struct bvhd_batch *batch, bool (*is_true)(const void *context))
{
    if (!batch)
        return 1; /* all of its items, which are none */
    client_lock(batch->client);
    int result = is_true(batch);
    client_unlock(batch->client);
    return result;
}

int bvhd_batch_is_copied(struct bvhd_batch *batch)
{
    return ask(batch, is_copied);
}

int bvhd_batch_is_done(struct bvhd_batch *batch)
{
    return ask(batch, is_done);
}

static bool build_one(struct bvhd_client *client, const void *context)
{
    return local_builds_in_wait(client) && local_builds_run(client, &parallel_serial, context);
}

static enum bvhd_status wait_for(struct bvhd_batch *batch, int timeout_ms, bool (*is_true)(const void *context))
{
    struct client_wait wait = {.is_true = is_true, .context = batch, .work = build_one};
    if (!batch)
        return BVHD_INVALID;
    struct bvhd_client *client = batch->client; /* a callback may destroy the batch */
    client_lock(client);
    bool result = client_wait_until(client, library_after(clock_ns(), timeout_ms), &wait);
    client_unlock(client);
    return result ? BVHD_OK : BVHD_PENDING;
}

enum bvhd_status bvhd_batch_wait(struct bvhd_batch *batch, int timeout_ms)
{
    return wait_for(batch, timeout_ms, is_done);
}

enum bvhd_status bvhd_batch_wait_copied(struct bvhd_batch *batch, int timeout_ms)
{
    return wait_for(batch, timeout_ms, is_copied);
}

const struct bvhd_result *bvhd_batch_result(struct bvhd_batch *batch, uint32_t index)
{
    if (!batch || index >= batch->count)
        return NULL;
    client_lock(batch->client);
    bool done = batch->items[index].state == ITEM_DONE;
    client_unlock(batch->client);
    return done ? &batch->items[index].result : &pending;
}
