/* SPDX-License-Identifier: Apache-2.0 */
#include "client/client_submit.h"

#include "client/argument.h"
#include "client/client_batch.h"
#include "client/client_deadline.h"
#include "client/client_link.h"
#include "client/client_wait.h"
#include "client/dependency.h"
#include "client/format.h"
#include "proto/wire/rows.h"
#include "proto/base/validate_batch.h"

/* The state of one call of bvhd_batch_submit. */
struct submission {
    struct bvhd_client *client;
    const struct bvhd_build *build;
    const struct bvhd_error *known; /* one for each info, of what is known to be wrong with it; NULL: nothing is */
    struct build_options options;
    struct reference_table references;
    struct bvhd_error *errors; /* one for each info */
    struct bvhd_error *batch_errors; /* one for each info: the rules between infos */
    struct bvhd_batch *batch;
};

static enum bvhd_status no_memory(struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, "batch", "no memory for it");
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

/* Queues the batch for a daemon, or for this process. */
static void enqueue(struct bvhd_batch *batch)
{
    struct bvhd_client *client = batch->client;
    batch->submitted_at = clock_ns();
    batch->connect_by = batch->submitted_at + client->connect_timeout;
    client_deadline_add(batch);
    if (batch->keys)
        local_builds_answer_held(batch);
    for (uint32_t i = 0; !batch->keys && i < batch->count; i++)
        local_builds_hold_named(batch, i); /* without memory it is tried again when it is built */
    if (client->local.policy == BVHD_LOCAL_ALWAYS)
        local_builds_take(batch);
    else if (batch->remaining > 0)
        client_batch_enqueue(batch, false);
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
        if (batch->dependencies && batch->dependencies->lookup)
            enqueue(batch->dependencies->lookup);
        enqueue(batch);
        client_advance(client);
    }
    client_unlock(client);
}

static enum bvhd_status check_build(const struct bvhd_build *build, struct build_options *ret_options,
                                    struct bvhd_error *error)
{
    bool is_older = build->struct_size == FORMAT_BUILD_WITHOUT || build->struct_size == FORMAT_BUILD_RAYLESS ||
                    build->struct_size == FORMAT_BUILD_BUILDERLESS;
    enum bvhd_status status = argument_check_size(build, is_older ? build->struct_size : sizeof *build, sizeof *build,
                                                  "build", "bvhd_build", error);
    if (status != BVHD_OK)
        return status;
    if (build->info_count > 0 && !build->infos)
        return bvhd_error_rule(error, BVHD_VUID_Build_pInfos_parameter, "build.infos",
                               "build.infos is NULL, but info_count is %u", build->info_count);
    if (build->reference_count > 0 && !build->references)
        return bvhd_error_set(error, BVHD_INVALID, "build.references",
                              "build.references is NULL, but reference_count is %u", build->reference_count);
    return format_options(build, ret_options, error);
}

/* Gives the updates the keys of what they update. Without one, an update is refused where it is prepared. */
static void name_sources(const struct submission *submission)
{
    struct vulkan_input *input = submission->batch->input;
    for (uint32_t i = 0; i < submission->build->info_count; i++) {
        const struct build_input *entry = &vulkan_input_entries(input)[i];
        bool is_update = entry->mode == MODE_UPDATE && entry->source != 0;
        const struct bvhd_key *given = is_update ? reference_table_key(&submission->references, entry->source) : NULL;
        struct key key;
        if (!given)
            continue;
        memcpy(key.bytes, given->bytes, sizeof key.bytes);
        vulkan_input_set_source_key(input, i, &key);
    }
}

/* Makes the batch's descriptions from Vulkan's structs. */
static enum bvhd_status describe(struct submission *submission)
{
    const struct bvhd_build *build = submission->build;
    const struct reference_table *table = &submission->references;
    submission->errors = memory_array(&library_memory, (uint64_t)build->info_count + 1, sizeof *submission->errors);
    submission->batch_errors =
        memory_array(&library_memory, (uint64_t)build->info_count + 1, sizeof *submission->batch_errors);
    if (!submission->errors || !submission->batch_errors)
        return BVHD_NO_MEMORY;
    enum bvhd_status status =
        vulkan_input_create_in(&library_memory, build->infos, build->info_count, build->ranges, table->references,
                               table->count, &submission->options, &submission->batch->input, submission->errors);
    if (status == BVHD_OK)
        name_sources(submission);
    if (status == BVHD_OK)
        status = validate_batch_destinations(vulkan_input_entries(submission->batch->input), build->info_count,
                                             &library_memory, submission->batch_errors);
    if (status == BVHD_OK)
        status = dependency_make(submission->batch, table);
    return status;
}

/* Returns the first error of an info, or one that is none. */
static const struct bvhd_error *error_of(const struct submission *submission, uint32_t info)
{
    if (submission->known && submission->known[info].status != BVHD_OK)
        return &submission->known[info];
    return submission->errors[info].status != BVHD_OK ? &submission->errors[info] : &submission->batch_errors[info];
}

/*
 * Fails the infos that break a rule. The client checks the rules between infos itself, because it cuts a batch into
 * several requests, in which the daemon cannot see them.
 */
static void fail_broken(struct submission *submission)
{
    client_lock(submission->client);
    for (uint32_t i = 0; i < submission->build->info_count; i++) {
        const struct bvhd_error *error = error_of(submission, i);
        bool is_done = submission->batch->items[i].state == ITEM_DONE; /* it depended on one that has failed */
        if (error->status != BVHD_OK && !is_done)
            client_batch_fail_item(submission->batch, i, error);
    }
    client_unlock(submission->client);
}

enum bvhd_status client_submit(struct bvhd_client *client, const struct bvhd_build *build,
                               const struct bvhd_error *known, struct bvhd_batch **ret_batch,
                               struct bvhd_error *ret_error)
{
    struct submission submission = {.client = client, .build = build, .known = known};
    enum bvhd_status status = check_build(build, &submission.options, ret_error);
    if (status != BVHD_OK)
        return status;
    status = reference_table_make(build, &library_memory, &submission.references, ret_error);
    if (status != BVHD_OK)
        return status;
    submission.batch = client_batch_create(client, build->info_count, (int32_t)build->priority);
    status = submission.batch ? describe(&submission) : BVHD_NO_MEMORY;
    if (status == BVHD_OK)
        submission.batch->deadline_ms = format_deadline(build);
    if (status == BVHD_OK)
        fail_broken(&submission);
    reference_table_finish(&submission.references, &library_memory);
    memory_free(&library_memory, submission.errors);
    memory_free(&library_memory, submission.batch_errors);
    if (status != BVHD_OK) {
        client_batch_free(submission.batch);
        return no_memory(ret_error);
    }
    copy_large(submission.batch);
    start(submission.batch);
    if (submission.batch->is_refused) {
        bvhd_batch_destroy(submission.batch);
        return local_builds_refusal(ret_error);
    }
    *ret_batch = submission.batch;
    return BVHD_OK;
}

enum bvhd_status bvhd_batch_submit(struct bvhd_client *client, const struct bvhd_build *build,
                                   struct bvhd_batch **ret_batch, struct bvhd_error *ret_error)
{
    enum bvhd_status status =
        ARGUMENTS_CHECK(ret_error, {client, "client"}, {build, "build"}, {ret_batch, "ret_batch"});
    return status == BVHD_OK ? client_submit(client, build, NULL, ret_batch, ret_error) : status;
}

enum bvhd_status bvhd_batch_fetch(struct bvhd_client *client, uint32_t key_count, const struct bvhd_key *keys,
                                  struct bvhd_batch **ret_batch, struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {client, "client"}, {ret_batch, "ret_batch"});
    if (status == BVHD_OK && key_count > 0 && !keys)
        status = bvhd_error_set(ret_error, BVHD_INVALID, "keys", "keys is NULL, but key_count is %u", key_count);
    if (status != BVHD_OK)
        return status;
    struct bvhd_batch *batch = client_batch_create_keys(client, key_count, PRIORITY_NORMAL);
    if (!batch)
        return no_memory(ret_error);
    for (uint32_t i = 0; i < key_count; i++)
        memcpy(batch->keys[i].bytes, keys[i].bytes, sizeof batch->keys[i].bytes);
    start(batch);
    *ret_batch = batch;
    return BVHD_OK;
}
