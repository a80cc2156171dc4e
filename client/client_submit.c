/* SPDX-License-Identifier: Apache-2.0 */
#include "client/client_batch.h"
#include "client/client_link.h"
#include "client/client_wait.h"
#include "client/format.h"
#include "proto/wire/rows.h"
#include "proto/base/validate_batch.h"

/* The state of one call of bvhd_batch_submit. */
struct submission {
    struct bvhd_client *client;
    const struct bvhd_build *build;
    struct build_options options;
    struct reference *references;
    struct bvhd_error *errors; /* one for each info */
    struct bvhd_error *batch_errors; /* one for each info: the rules between infos */
    struct bvhd_batch *batch;
};

static struct bvhd_batch *create_batch(struct bvhd_client *client, uint32_t count, int32_t priority)
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

static enum bvhd_status no_memory(struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, "batch", "no memory for it");
}

/* Adds the batch to the queue, behind older batches of the same priority. */
static void enqueue(struct bvhd_batch *batch)
{
    struct bvhd_batch **at = &batch->client->queue;
    while (*at && (*at)->priority >= batch->priority)
        at = &(*at)->next;
    batch->next = *at;
    *at = batch;
    batch->queued = true;
    batch->deadline = clock_ns() + batch->client->connect_timeout;
}

/*
 * Copies the payload of the first item if no pool can hold it. That takes long, so it happens before other threads see
 * the batch, and without the lock, so that they do not have to wait. If it fails here, it is tried again with the other
 * items, and the error is reported there.
 */
static void copy_large(struct bvhd_batch *batch)
{
    struct bvhd_client *client = batch->client;
    const struct build_input *input = vulkan_input_entries(batch->input);
    uint64_t size;
    if (batch->count == 0 || batch->items[0].state != ITEM_WAITING || !rows_payload_size(input, &size) ||
        size <= client->placement.wanted_size)
        return;
    client_lock(client);
    bool reserved = placement_reserve(&client->placement);
    client_unlock(client);
    if (!reserved)
        return;
    enum bvhd_status status = placement_fill(&library_memory, input, size, &batch->items[0].held, NULL);
    client_lock(client);
    if (status == BVHD_OK)
        client_batch_set_copied(batch, 0);
    else
        placement_unreserve(&client->placement);
    client_unlock(client);
}

/*
 * Receives before it sends, so that a lost connection is noticed: what is submitted after a loss must not share its
 * failure.
 */
static void start(struct bvhd_batch *batch)
{
    struct bvhd_client *client = batch->client;
    client_lock(client);
    if (batch->remaining > 0) {
        client_look(client);
        enqueue(batch);
        client_advance(client);
    }
    client_unlock(client);
}

static enum bvhd_status check_build(const struct bvhd_build *build, struct build_options *ret_options,
                                    struct bvhd_error *error)
{
    bool is_older = build->struct_size == FORMAT_BUILD_WITHOUT || build->struct_size == FORMAT_BUILD_RAYLESS;
    if (build->struct_size < sizeof *build && !is_older)
        return bvhd_error_set(error, BVHD_INVALID, "build.struct_size",
                              "%zu bytes instead of sizeof(struct bvhd_build)", build->struct_size);
    if (build->info_count > 0 && !build->infos)
        return bvhd_error_set(error, BVHD_INVALID, "build.infos", "not given");
    if (build->reference_count > 0 && !build->references)
        return bvhd_error_set(error, BVHD_INVALID, "build.references", "not given");
    return format_options(build, ret_options, error);
}

static void convert_references(const struct bvhd_build *build, struct reference *references)
{
    for (uint32_t i = 0; i < build->reference_count; i++) {
        const struct bvhd_reference *from = &build->references[i];
        references[i] =
            (struct reference){.kind = REFERENCE_BLAS, .handle = from->handle, .has_key = from->has_key != 0};
        memcpy(references[i].key.bytes, from->key.bytes, sizeof references[i].key.bytes);
        memcpy(references[i].bounds.min, from->bounds, sizeof references[i].bounds.min);
        memcpy(references[i].bounds.max, from->bounds + 3, sizeof references[i].bounds.max);
        memcpy(&references[i].slabs, from->slabs, sizeof references[i].slabs);
    }
}

/* Makes the batch's descriptions from Vulkan's structs. */
static enum bvhd_status describe(struct submission *submission)
{
    const struct bvhd_build *build = submission->build;
    submission->references =
        memory_array(&library_memory, (uint64_t)build->reference_count + 1, sizeof *submission->references);
    submission->errors = memory_array(&library_memory, (uint64_t)build->info_count + 1, sizeof *submission->errors);
    submission->batch_errors =
        memory_array(&library_memory, (uint64_t)build->info_count + 1, sizeof *submission->batch_errors);
    if (!submission->references || !submission->errors || !submission->batch_errors)
        return BVHD_NO_MEMORY;
    convert_references(build, submission->references);
    enum bvhd_status status = vulkan_input_create_in(
        &library_memory, build->infos, build->info_count, build->ranges, submission->references, build->reference_count,
        &submission->options, &submission->batch->input, submission->errors);
    if (status == BVHD_OK)
        status = validate_batch(vulkan_input_entries(submission->batch->input), build->info_count, &library_memory,
                                submission->batch_errors);
    return status;
}

/*
 * Fails the infos that break a rule. The client checks the rules between infos itself, because it cuts a batch into
 * several requests, in which the daemon cannot see them.
 */
static void fail_broken(struct submission *submission)
{
    client_lock(submission->client);
    for (uint32_t i = 0; i < submission->build->info_count; i++) {
        const struct bvhd_error *error =
            submission->errors[i].status != BVHD_OK ? &submission->errors[i] : &submission->batch_errors[i];
        if (error->status != BVHD_OK)
            client_batch_fail_item(submission->batch, i, error);
    }
    client_unlock(submission->client);
}

static int32_t priority_of(const struct bvhd_build *build)
{
    return build->priority < BVHD_PRIORITY_LOW    ? PRIORITY_LOW
           : build->priority > BVHD_PRIORITY_HIGH ? PRIORITY_HIGH
                                                  : (int32_t)build->priority;
}

enum bvhd_status bvhd_batch_submit(struct bvhd_client *client, const struct bvhd_build *build,
                                   struct bvhd_batch **ret_batch, struct bvhd_error *ret_error)
{
    struct submission submission = {.client = client, .build = build};
    enum bvhd_status status = check_build(build, &submission.options, ret_error);
    if (status != BVHD_OK)
        return status;
    submission.batch = create_batch(client, build->info_count, priority_of(build));
    status = submission.batch ? describe(&submission) : BVHD_NO_MEMORY;
    if (status == BVHD_OK)
        fail_broken(&submission);
    memory_free(&library_memory, submission.references);
    memory_free(&library_memory, submission.errors);
    memory_free(&library_memory, submission.batch_errors);
    if (status != BVHD_OK) {
        if (submission.batch)
            vulkan_input_destroy(submission.batch->input);
        memory_free(&library_memory, submission.batch);
        return no_memory(ret_error);
    }
    copy_large(submission.batch);
    start(submission.batch);
    *ret_batch = submission.batch;
    return BVHD_OK;
}

enum bvhd_status bvhd_batch_fetch(struct bvhd_client *client, uint32_t key_count, const struct bvhd_key *keys,
                                  struct bvhd_batch **ret_batch, struct bvhd_error *ret_error)
{
    struct bvhd_batch *batch = create_batch(client, key_count, PRIORITY_NORMAL);
    struct key *copies = memory_array(&library_memory, (uint64_t)key_count + 1, sizeof *copies);
    if (!batch || !copies) {
        memory_free(&library_memory, batch);
        memory_free(&library_memory, copies);
        return no_memory(ret_error);
    }
    for (uint32_t i = 0; i < key_count; i++) {
        memcpy(copies[i].bytes, keys[i].bytes, sizeof copies[i].bytes);
        batch->items[i].state = ITEM_COPIED; /* there is no geometry to copy */
    }
    batch->uncopied = 0;
    batch->keys = copies;
    start(batch);
    *ret_batch = batch;
    return BVHD_OK;
}
