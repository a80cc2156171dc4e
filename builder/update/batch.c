/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/batch.h"

#include <string.h>

#include "builder/input/validate.h"
#include "proto/base/clock.h"
#include "proto/base/place.h"

/*
 * Finds built items by their keys. Open addressing: a slot holds an item's index + 1, or 0 when it is free. A key is a
 * cryptographic hash, so its first bytes are spread evenly whatever a client sends.
 */
struct built {
    uint32_t *slots;
    uint64_t mask; /* number of slots - 1; the number is a power of two, and at least half of the slots stay free */
};

static enum bvhd_status built_init(struct built *built, uint32_t count, struct memory *memory)
{
    uint64_t size = 2;
    while (size < 2 * (uint64_t)count)
        size *= 2;
    built->mask = size - 1;
    built->slots = memory_array(memory, size, sizeof *built->slots);
    if (!built->slots)
        return BVHD_NO_MEMORY;
    memset(built->slots, 0, size * sizeof *built->slots);
    return BVHD_OK;
}

/* Returns the slot of the item with that key, or the free slot where it belongs. */
static uint32_t *built_find(const struct built *built, const struct batch_item *items, const struct key *key)
{
    uint64_t at = bytes_get64(key->bytes) & built->mask;
    while (built->slots[at] && !key_equal(&items[built->slots[at] - 1].key, key))
        at = (at + 1) & built->mask;
    return &built->slots[at];
}

struct batch {
    const struct batch_call *call;
    const struct build_context *context;
    struct batch_item *items;
    struct built built;
    uint64_t done, weight, total; /* primitives: of the items before, of the item that is built, and of all */
};

/* Counts the primitives of an item, and one more for the item. It is called before the item has been validated. */
static uint64_t weight_of(const struct build_input *input, const struct limits *limits)
{
    uint64_t weight = 1;
    for (uint32_t i = 0;
         input->geometries && input->geometry_count <= limits->max_geometries && i < input->geometry_count; i++)
        weight += input->geometries[i].range.primitive_count;
    return weight;
}

/* Passes on the progress of one item as that of the batch. */
static void report(void *context, uint64_t done, uint64_t total)
{
    const struct batch *batch = context;
    double share = total && done < total ? (double)done / (double)total : 1;
    batch->context->progress(batch->context->progress_context, batch->done + (uint64_t)(share * (double)batch->weight),
                             batch->total);
}

static void share_item(const struct batch_item *equal, struct batch_item *item)
{
    item->coalesced = true;
    item->blob = equal->blob;
    item->size = equal->size;
    item->record = equal->record;
    item->summary = equal->summary;
}

static void free_bytes(struct memory *memory, struct bytes bytes)
{
    memory_free(memory, (void *)(uintptr_t)bytes.data);
}

static void free_cached(struct batch_cached *cached, struct memory *memory)
{
    free_bytes(memory, cached->record);
    memory_free(memory, cached->blob);
}

/* A structure that may be updated is taken with its record only: without it the updates would have to build. */
static bool take_cached(const struct batch *batch, const struct build_entry *entry, struct memory *memory,
                        struct batch_item *item)
{
    struct batch_cache *cache = batch->call->cache;
    struct batch_cached cached = {.blob = NULL};
    if (!cache || entry->is_update || !cache->get(cache, &entry->key, entry->record.header, memory, &cached))
        return false;
    if (cached.summary.target != entry->options.target) {
        free_cached(&cached, memory);
        return false;
    }
    item->cached = true;
    item->blob = cached.blob;
    item->size = cached.size;
    item->record = cached.record;
    item->summary = cached.summary;
    return true;
}

/* The item takes the record over. */
static enum bvhd_status make_new(const struct batch *batch, struct build_entry *entry,
                                 const struct build_entry_source *source, const struct build_context *context,
                                 struct batch_item *item)
{
    struct batch_cache *cache = batch->call->cache;
    struct build_made made;
    double begin = clock_ms();
    enum bvhd_status status = build_entry_make(entry, source, context, &made, &item->error);
    item->build_ms = clock_ms() - begin;
    if (status != BVHD_OK)
        return status;
    item->blob = made.blob;
    item->size = made.size;
    item->record = entry->record.bytes;
    entry->record = (struct record){.owned = NULL};
    item->summary = made.summary;
    item->summary.build_ms = item->build_ms;
    if (cache && !entry->is_update)
        cache->put(cache, &item->key, (struct bytes){item->blob, item->size}, item->record, &item->summary);
    return BVHD_OK;
}

static enum bvhd_status find_or_make(const struct batch *batch, struct build_entry *entry,
                                     const struct build_entry_source *source, const struct build_context *context,
                                     struct batch_item *item)
{
    enum bvhd_status status = BVHD_OK;
    item->key = entry->key;
    uint32_t *slot = built_find(&batch->built, batch->items, &item->key);
    if (*slot) {
        share_item(&batch->items[*slot - 1], item);
        return BVHD_OK;
    }
    if (!take_cached(batch, entry, context->memory, item))
        status = make_new(batch, entry, source, context, item);
    if (status == BVHD_OK) {
        memory_hand_up(context->memory, item->blob);
        memory_hand_up(context->memory, (void *)(uintptr_t)item->record.data);
        *slot = (uint32_t)(item - batch->items) + 1;
    }
    return status;
}

/* Returns whether there is a source. *ret_read, which is all 0 before, gets it if it had to be read. */
static bool find_source(const struct batch *batch, const struct key *key, struct memory *memory,
                        struct batch_cached *ret_read, struct build_entry_source *ret_source)
{
    struct batch_cache *cache = batch->call->cache;
    struct batch_held *held = batch->call->held;
    const struct batch_item *item = held ? held->find(held, key) : NULL;
    if (item) {
        *ret_source = (struct build_entry_source){{item->blob, item->size}, item->record};
        return true;
    }
    if (!cache || !cache->get(cache, key, true, memory, ret_read))
        return false;
    *ret_source = (struct build_entry_source){{ret_read->blob, ret_read->size}, ret_read->record};
    return true;
}

static enum bvhd_status run_entry(const struct batch *batch, uint32_t index, const struct build_context *context,
                                  struct batch_item *item)
{
    const struct build_input *input = &batch->call->inputs[index];
    struct batch_cached read = {.blob = NULL};
    struct build_entry_source source = {0};
    struct build_entry entry;
    double begin = clock_ms();
    bool has_source =
        input->mode == MODE_UPDATE && find_source(batch, &input->source_key, context->memory, &read, &source);
    enum bvhd_status status = build_entry_prepare(input, index, batch->call->limits, has_source ? &source : NULL,
                                                  context, &entry, &item->error);
    item->prepare_ms = clock_ms() - begin;
    if (status == BVHD_OK) {
        status = find_or_make(batch, &entry, &source, context, item);
        build_entry_finish(&entry, context->memory);
    }
    free_cached(&read, context->memory);
    return status;
}

/* Makes one item in a memory budget of its own, whose peak is then the item's. */
static void run_item(struct batch *batch, uint32_t index)
{
    struct batch_item *item = &batch->items[index];
    struct build_context context = *batch->context;
    struct memory memory;
    if (context_cancelled(&context)) {
        item->status = bvhd_error_set(&item->error, BVHD_CANCELLED, place("infos[%u]", index).text, "cancelled");
        return;
    }
    memory_init_within(&memory, batch->context->memory, UINT64_MAX);
    context.memory = &memory;
    context.progress = context.progress ? report : NULL;
    context.progress_context = batch;
    item->status = run_entry(batch, index, &context, item);
    memory_explain(&memory, &item->error);
    item->summary.peak_bytes = atomic_load(&memory.peak);
}

/* `errors`: for each entry, what validate_batch found about the rules between entries. */
static void run_items(struct batch *batch, const struct bvhd_error *errors)
{
    const struct batch_call *call = batch->call;
    memset(batch->items, 0, call->count * sizeof *batch->items);
    for (uint32_t i = 0; i < call->count; i++)
        batch->total += weight_of(&call->inputs[i], call->limits);
    for (uint32_t i = 0; i < call->count; i++) {
        batch->items[i].status = errors[i].status;
        batch->items[i].error = errors[i];
        batch->weight = weight_of(&call->inputs[i], call->limits);
        if (errors[i].status == BVHD_OK)
            run_item(batch, i);
        batch->done += batch->weight;
    }
}

enum bvhd_status batch_run(const struct batch_call *call, const struct build_context *context,
                           struct batch_item *ret_items, struct bvhd_error *error)
{
    const uint32_t count = call->count;
    if (count == 0)
        return BVHD_OK;
    struct batch batch = {.call = call, .context = context, .items = ret_items};
    struct memory *memory = context->memory;
    struct bvhd_error *errors = memory_array(memory, count, sizeof *errors);
    enum bvhd_status status = errors ? built_init(&batch.built, count, memory) : BVHD_NO_MEMORY;
    if (status == BVHD_OK)
        status = validate_batch(call->inputs, count, memory, errors);
    if (status == BVHD_OK)
        run_items(&batch, errors);
    memory_free(memory, batch.built.slots);
    memory_free(memory, errors);
    return status == BVHD_OK ? status : bvhd_error_set(error, status, "", "no memory for a batch of %u", count);
}

enum bvhd_status batch_build(const struct build_input *inputs, uint32_t count, const struct limits *limits,
                             const struct build_context *context, struct batch_item *ret_items,
                             struct bvhd_error *error)
{
    const struct batch_call call = {.inputs = inputs, .count = count, .limits = limits};
    return batch_run(&call, context, ret_items, error);
}

void batch_finish(struct batch_item *items, uint32_t count, struct memory *memory)
{
    for (uint32_t i = 0; items && i < count; i++) {
        if (!items[i].coalesced) {
            memory_free(memory, items[i].blob);
            free_bytes(memory, items[i].record);
        }
        items[i].blob = NULL;
        items[i].record = (struct bytes){NULL, 0};
    }
}
