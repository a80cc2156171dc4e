/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/backend_local.h"

#include <string.h>

#include "builder/workers.h"
#include "client/bvhctl/service/local_cache.h"
#include "client/format.h"
#include "client/reference.h"
#include "client/result_summary.h"
#include "client/vulkan_input.h"
#include "proto/base/clock.h"
#include "proto/base/container_of.h"
#include "proto/base/timed_parallel.h"

/* The owner of the results' bytes. */
struct hold {
    struct hold *next; /* of the backend */
    struct batch_item *items;
    uint32_t count;
    uint32_t found; /* the item that was found last */
};

static void release(struct backend *backend, void *context)
{
    struct backend_local *local = (struct backend_local *)backend;
    struct memory *memory = local->context.memory;
    struct hold *hold = context;
    if (!hold)
        return;
    for (struct hold **at = &local->holds; *at; at = &(*at)->next)
        if (*at == hold) {
            *at = hold->next;
            break;
        }
    batch_finish(hold->items, hold->count, memory);
    memory_free(memory, hold->items);
    memory_free(memory, hold);
}

static struct hold *make_hold(uint32_t count, struct memory *memory)
{
    struct hold *hold = memory_alloc(memory, sizeof *hold);
    if (!hold)
        return NULL;
    *hold = (struct hold){.items = memory_array(memory, count, sizeof *hold->items), .count = count};
    if (!hold->items) {
        memory_free(memory, hold);
        return NULL;
    }
    memset(hold->items, 0, count * sizeof *hold->items);
    return hold;
}

/* Begins behind the item that was found last, because the updates of a frame ask for results in their order. */
static const struct batch_item *find_in(struct hold *hold, const struct key *key)
{
    for (uint32_t i = 0; i < hold->count; i++) {
        uint32_t at = (uint32_t)(((uint64_t)hold->found + 1 + i) % hold->count);
        const struct batch_item *item = &hold->items[at];
        if (item->blob && item->status == BVHD_OK && key_equal(&item->key, key)) {
            hold->found = at;
            return item;
        }
    }
    return NULL;
}

static const struct batch_item *find_held(struct batch_held *held, const struct key *key)
{
    const struct backend_local *local = container_of(held, struct backend_local, held);
    const struct batch_item *item = NULL;
    for (struct hold *hold = local->holds; hold && !item; hold = hold->next)
        item = find_in(hold, key);
    return item;
}

static void copy_references(const struct bvhd_build *build, struct reference *references)
{
    for (uint32_t i = 0; i < build->reference_count; i++) {
        const struct bvhd_reference *from = &build->references[i];
        references[i] = (struct reference){
            .kind = REFERENCE_BLAS, .handle = from->handle, .moves = from->moves, .has_key = from->has_key};
        memcpy(&references[i].key, &from->key, sizeof references[i].key);
        memcpy(&references[i].bounds, from->bounds, sizeof references[i].bounds);
        memcpy(&references[i].slabs, from->slabs, sizeof references[i].slabs);
    }
}

static void copy_result(const struct batch_item *item, struct bvhd_result *ret_result)
{
    struct bvhd_result result = {
        .error = item->error,
        .data = item->blob,
        .size = item->size,
        .origin = item->coalesced ? BVHD_ORIGIN_COALESCED
                  : item->cached  ? BVHD_ORIGIN_DISK
                                  : BVHD_ORIGIN_BUILT,
        .prepare_ms = item->prepare_ms,
        .build_ms = item->build_ms,
        .moves = reference_moves((struct bytes){item->blob, item->blob ? item->size : 0}),
    };
    result.error.status = item->status;
    memcpy(&result.key, &item->key, sizeof result.key);
    if (item->status == BVHD_OK)
        result_summary_copy(&item->summary, &result);
    *ret_result = result;
}

/* `errors`: for each item, the rule of Vulkan that its structs break, which was found before the builds. */
static void copy_results(const struct hold *hold, const struct bvhd_error *errors, struct bvhd_result *ret_results)
{
    for (uint32_t i = 0; i < hold->count; i++) {
        if (errors[i].status != BVHD_OK)
            ret_results[i] = (struct bvhd_result){.error = errors[i]};
        else
            copy_result(&hold->items[i], &ret_results[i]);
    }
}

/* Gives updates the keys of their sources, whose references are in the order of the infos. */
static void name_sources(const struct bvhd_build *build, const struct reference *references, struct vulkan_input *input)
{
    uint32_t at = 0;
    for (uint32_t i = 0; i < build->info_count; i++) {
        uint64_t handle = (uint64_t)build->infos[i].srcAccelerationStructure;
        if (build->infos[i].mode != VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR)
            continue;
        for (uint32_t k = 0; k < build->reference_count && references[at].handle != handle; k++)
            at = (at + 1) % build->reference_count;
        if (build->reference_count > 0 && references[at].handle == handle)
            vulkan_input_set_source_key(input, i, &references[at].key);
    }
}

/* Runs a batch that has a deadline; what it cancels has the error of a request to a daemon. */
static enum bvhd_status run_until(const struct build_context *shared, uint32_t deadline_ms,
                                  const struct batch_call *call, struct batch_item *items, struct bvhd_error *error)
{
    struct build_context context = *shared;
    struct timed_parallel timed;
    _Atomic uint64_t moment = clock_ns() + (uint64_t)deadline_ms * 1000000;
    atomic_bool cancel = false;
    timed_parallel_init(&timed, shared->parallel, &moment, &cancel);
    context.parallel = &timed.parallel;
    context.cancel = &cancel;
    enum bvhd_status status = batch_run(call, &context, items, error);
    for (uint32_t i = 0; status == BVHD_OK && i < call->count; i++)
        if (items[i].status == BVHD_CANCELLED)
            bvhd_error_deadline(&items[i].error, deadline_ms);
    return status;
}

static enum bvhd_status build_items(struct backend_local *local, const struct bvhd_build *build,
                                    const struct build_options *options, const struct reference *references,
                                    struct bvhd_error *errors, struct hold *hold, struct bvhd_error *error)
{
    struct limits limits = limits_default();
    struct vulkan_input *input = NULL;
    memset(errors, 0, build->info_count * sizeof *errors);
    enum bvhd_status status = vulkan_input_create(build->infos, build->info_count, build->ranges, references,
                                                  build->reference_count, options, &input, errors);
    if (status != BVHD_OK) {
        *error = errors[0];
    } else {
        name_sources(build, references, input);
        const struct batch_call call = {.inputs = vulkan_input_entries(input),
                                        .count = build->info_count,
                                        .limits = &limits,
                                        .cache = local_cache_of(local->cache),
                                        .held = &local->held};
        uint32_t deadline_ms = format_deadline(build);
        status = deadline_ms > 0 ? run_until(&local->context, deadline_ms, &call, hold->items, error)
                                 : batch_run(&call, &local->context, hold->items, error);
    }
    vulkan_input_destroy(input);
    return status;
}

static enum bvhd_status build_here(struct backend *backend, const struct bvhd_build *build,
                                   struct bvhd_result *ret_results, void **ret_hold, struct bvhd_error *error)
{
    struct backend_local *local = (struct backend_local *)backend;
    struct memory *memory = local->context.memory;
    struct build_options options;
    enum bvhd_status status = format_options(build, &options, error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_error *errors = memory_array(memory, build->info_count, sizeof *errors);
    struct reference *references = memory_array(memory, (uint64_t)build->reference_count + 1, sizeof *references);
    struct hold *hold = make_hold(build->info_count, memory);
    status = BVHD_NO_MEMORY;
    if (errors && references && hold) {
        copy_references(build, references);
        status = build_items(local, build, &options, references, errors, hold, error);
    } else {
        bvhd_error_set(error, status, "", "no memory for a batch of %u", build->info_count);
    }
    if (status == BVHD_OK) {
        copy_results(hold, errors, ret_results);
        hold->next = local->holds;
        local->holds = hold;
        *ret_hold = hold;
    } else {
        release(backend, hold);
    }
    memory_free(memory, references);
    memory_free(memory, errors);
    return status;
}

enum bvhd_status backend_local_open(struct backend_local *local, uint32_t threads, struct memory *memory,
                                    struct progress *progress, struct bvhd_error *error)
{
    *local = (struct backend_local){.backend = {build_here, release}, .held = {find_held}};
    enum bvhd_status status = workers_create(threads, &local->workers, error);
    if (status != BVHD_OK) {
        backend_local_close(local);
        return status;
    }
    local->context.memory = memory;
    local->context.parallel = workers_parallel(local->workers);
    local->context.progress = progress_update;
    local->context.progress_context = progress;
    return BVHD_OK;
}

enum bvhd_status backend_local_use_cache(struct backend_local *local, const struct options *options,
                                         struct bvhd_error *error)
{
    return local_cache_open(options, local->context.parallel, &local->cache, error);
}

void backend_local_close(struct backend_local *local)
{
    local_cache_close(local->cache);
    workers_destroy(local->workers);
    *local = (struct backend_local){0};
}
