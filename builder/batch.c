/* SPDX-License-Identifier: Apache-2.0 */
#include "batch.h"

#include <string.h>
#include <time.h>

#include "content_key.h"
#include "prepare.h"
#include "validate.h"

static double milliseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

/* Lets the memory's peak count from here; returns what is live. */
static uint64_t peak_begin(struct memory *memory)
{
    uint64_t live = atomic_load(&memory->live);
    atomic_store(&memory->peak, live);
    return live;
}

/* The earlier item that has the same bytes, or NULL. */
static const struct batch_item *find_equal(const struct batch_item *items, uint32_t index)
{
    for (uint32_t i = 0; i < index; i++)
        if (items[i].status == BVHD_OK && !items[i].coalesced && key_equal(&items[i].key, &items[index].key))
            return &items[i];
    return NULL;
}

static enum bvhd_status build_item(const struct canonical *canonical, const struct build_options *options,
                                   const struct build_context *context, struct batch_item *items, uint32_t index)
{
    struct batch_item *item = &items[index];
    enum build_quality quality = build_quality_resolve(options->quality, canonical->flags);
    enum bvhd_status status = content_key(canonical, quality, options->target, options->layout_flags, context->memory,
                                          context->parallel, &item->key, &item->error);
    if (status != BVHD_OK)
        return status;
    const struct batch_item *equal = find_equal(items, index);
    if (equal) {
        item->coalesced = true;
        item->blob = equal->blob;
        item->size = equal->size;
        item->stats = equal->stats;
        return BVHD_OK;
    }
    double begin = milliseconds();
    status = build(canonical, options, context, &item->blob, &item->stats, &item->error);
    item->build_ms = milliseconds() - begin;
    item->size = status == BVHD_OK ? item->stats.sizes.total : 0;
    return status;
}

static void run_item(const struct build_input *input, const struct limits *limits, const struct build_context *context,
                     struct batch_item *items, uint32_t index)
{
    struct batch_item *item = &items[index];
    struct canonical canonical;
    uint64_t live = peak_begin(context->memory);
    double begin = milliseconds();
    item->status = prepare(input, index, limits, context->memory, context->parallel, &canonical, &item->error);
    item->prepare_ms = milliseconds() - begin;
    if (item->status != BVHD_OK)
        return;
    item->status = build_item(&canonical, &input->options, context, items, index);
    prepare_finish(&canonical, context->memory);
    item->peak_bytes = atomic_load(&context->memory->peak) - live;
}

enum bvhd_status batch_build(const struct build_input *inputs, uint32_t count, const struct limits *limits,
                             const struct build_context *context, struct batch_item *ret_items, struct bvhd_error *error)
{
    struct bvhd_error *errors = count ? memory_array(context->memory, count, sizeof *errors) : NULL;
    if (count && !errors)
        return bvhd_error_set(error, BVHD_NO_MEMORY, "", "no memory for a batch of %u", count);
    enum bvhd_status status = count ? validate_batch(inputs, count, context->memory, errors) : BVHD_OK;
    if (status != BVHD_OK) {
        memory_free(context->memory, errors);
        return bvhd_error_set(error, status, "", "a batch of %u could not be checked", count);
    }
    memset(ret_items, 0, count * sizeof *ret_items);
    for (uint32_t i = 0; i < count; i++) {
        ret_items[i].status = errors[i].status;
        ret_items[i].error = errors[i];
        if (errors[i].status == BVHD_OK)
            run_item(&inputs[i], limits, context, ret_items, i);
    }
    memory_free(context->memory, errors);
    return BVHD_OK;
}

void batch_finish(struct batch_item *items, uint32_t count, struct memory *memory)
{
    for (uint32_t i = 0; items && i < count; i++) {
        if (!items[i].coalesced)
            memory_free(memory, items[i].blob);
        items[i].blob = NULL;
    }
}
