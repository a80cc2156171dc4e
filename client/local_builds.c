/* SPDX-License-Identifier: Apache-2.0 */
#include "client/local_builds.h"

#include "client/client_batch.h"
#include "client/client_deadline.h"
#include "client/client_wait.h"
#include "client/local_job.h"
#include "client/local_micromaps.h"
#include "client/local_sources.h"
#include "client/outgoing.h"
#include "proto/base/container_of.h"
#include "proto/base/place.h"

void local_builds_init(struct local_builds *builds, const struct bvhd_client_options *options)
{
    *builds = (struct local_builds){.policy = options->local};
    local_threads_init(&builds->threads, options->local_threads);
}

void local_builds_finish(struct bvhd_client *client)
{
    local_threads_finish(client);
    local_results_finish(&client->local.results);
}

/* ---- which items are built, and in which order ---- */

enum bvhd_status local_builds_refusal(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_UNSUPPORTED, "options.local_threads",
                          "no daemon answers, and 0 allows no thread to build in this process: the event loop "
                          "of a program that uses bvhd_client_descriptor must not");
}

bool local_builds_in_wait(const struct bvhd_client *client)
{
    return client->local.threads.allowed == 0;
}

/* Returns the batch's first item that is copied and that no thread has taken; its count if there is none. */
static uint32_t first_ready(struct bvhd_batch *batch)
{
    while (batch->first_unsent < batch->count && batch->items[batch->first_unsent].state >= ITEM_SENT)
        batch->first_unsent++;
    for (uint32_t i = batch->first_unsent; i < batch->first_uncopied; i++)
        if (batch->items[i].state == ITEM_COPIED)
            return i;
    return batch->count;
}

/* Finds the item that is next, and takes batches out of the queue whose items have all been taken. */
static struct bvhd_batch *find_work(struct bvhd_client *client, const struct bvhd_batch *own, uint32_t *ret_index)
{
    struct bvhd_batch *found = NULL;
    for (struct bvhd_batch *batch = client->local.queue, *next; batch; batch = next) {
        next = batch->next;
        if (found && batch->priority < found->priority)
            break;
        if (found && batch != own)
            continue;
        uint32_t index = first_ready(batch);
        if (batch->first_unsent == batch->count)
            client_batch_unqueue(batch);
        if (index == batch->count)
            continue;
        found = batch;
        *ret_index = index;
    }
    return found;
}

bool local_builds_has_work(struct bvhd_client *client)
{
    uint32_t index;
    return find_work(client, NULL, &index) != NULL;
}

void local_builds_wake(struct bvhd_client *client)
{
    struct bvhd_error error;
    if (!client->local.queue || local_builds_in_wait(client) || !local_builds_has_work(client) ||
        local_threads_wake(client, &error) == BVHD_OK)
        return;
    while (client->local.queue)
        client_batch_fail_unsent(client->local.queue, &error);
}

/* ---- taking batches over ---- */

/* Fails a key as a daemon does. */
static void fail_key(struct bvhd_batch *batch, uint32_t index)
{
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_NOT_FOUND, place("keys[%u]", index).text, "no structure of this key is known");
    client_batch_fail_item(batch, index, &error);
}

static struct local_job *find_job(const struct bvhd_client *client, const struct key *key)
{
    struct list_link *link = client->local.jobs.first;
    while (link && !key_equal(&container_of(link, struct local_job, link)->entry.key, key))
        link = link->next;
    return link ? container_of(link, struct local_job, link) : NULL;
}

/* A job ends at the latest deadline of those who wait for it. */
static void update_deadline(struct local_job *job)
{
    uint64_t latest = 0;
    for (struct list_link *link = job->waiters.first; link; link = link->next) {
        uint64_t deadline = client_deadline_of(container_of(link, struct client_item, local.link)->local.batch);
        latest = deadline > latest ? deadline : latest;
    }
    atomic_store_explicit(&job->deadline, latest, memory_order_relaxed);
}

static void join(struct local_job *job, struct bvhd_batch *batch, struct client_item *item)
{
    item->state = ITEM_BUILDING;
    item->local.batch = batch;
    item->local.job = job;
    list_append(&job->waiters, &item->local.link);
    update_deadline(job);
}

/* Lists an item that is done, so that it answers later requests; one that has kept only the bounds cannot. */
static void list_result(struct bvhd_client *client, struct client_item *item)
{
    if (item->result.blob)
        local_results_add(&client->local.results, item);
}

static void share(struct bvhd_batch *batch, uint32_t index, const struct client_item *held)
{
    client_batch_share_item(batch, index, held);
    list_result(batch->client, &batch->items[index]);
}

/* Answers a key by what is held or being built here. Returns false if that is neither. */
static bool answer_key(struct bvhd_batch *batch, uint32_t index)
{
    struct bvhd_client *client = batch->client;
    const struct client_item *held = local_results_find(&client->local.results, &batch->keys[index]);
    struct local_job *job = held ? NULL : find_job(client, &batch->keys[index]);
    if (held)
        share(batch, index, held);
    else if (job)
        join(job, batch, &batch->items[index]);
    return held || job;
}

void local_builds_answer_held(struct bvhd_batch *batch)
{
    if (batch->client->local.results.count == 0 && !batch->client->local.jobs.first)
        return;
    for (uint32_t i = 0; i < batch->count; i++)
        if (batch->items[i].state == ITEM_COPIED)
            answer_key(batch, i);
}

static void answer_keys(struct bvhd_batch *batch)
{
    client_batch_unqueue(batch);
    for (uint32_t i = 0; i < batch->count; i++)
        if (batch->items[i].state < ITEM_SENT && !answer_key(batch, i))
            fail_key(batch, i);
}

void local_builds_take(struct bvhd_batch *batch)
{
    struct bvhd_client *client = batch->client;
    if (batch->keys) {
        answer_keys(batch);
    } else if (client->wakeups.has_loop && local_builds_in_wait(client)) {
        struct bvhd_error error;
        local_builds_refusal(&error);
        client_batch_fail_unsent(batch, &error);
        batch->is_refused = true;
    } else {
        client_batch_enqueue(batch, true);
        client_stir(client); /* a thread that waits may build it */
    }
}

void local_builds_take_all(struct bvhd_client *client)
{
    while (client->queue)
        local_builds_take(client->queue);
}

/* ---- running one item ---- */

bool local_builds_hold_named(struct bvhd_batch *batch, uint32_t index)
{
    struct client_item *item = &batch->items[index];
    const struct build_input *input = &vulkan_input_entries(batch->input)[index];
    if (item->state == ITEM_DONE)
        return true;
    if (!item->source && !key_is_zero(&input->source_key))
        item->source = local_sources_find(&input->source_key);
    return item->micromaps || local_micromaps_find(input, &item->micromaps);
}

/* Makes a job of an item. Returns NULL, and fails the item, without memory. */
static struct local_job *start_job(struct bvhd_batch *batch, uint32_t index)
{
    struct client_item *item = &batch->items[index];
    const struct build_input *input = &vulkan_input_entries(batch->input)[index];
    const unsigned char *bytes =
        item->held.kind == HELD_POOL ? placement_bytes(&batch->client->placement, &item->held) : NULL;
    struct control_item asked = outgoing_describe(input);
    struct local_job *job = NULL;
    if (local_builds_hold_named(batch, index))
        job = local_job_create(&asked, index, &item->held, bytes, item->source);
    if (job) {
        item->source = NULL;
        job->micromaps = item->micromaps;
        item->micromaps = NULL;
        join(job, batch, item);
    } else {
        struct bvhd_error error;
        bvhd_error_no_memory(&error, place("infos[%u]", index).text, "no memory to build it");
        client_batch_fail_item(batch, index, &error);
    }
    return job;
}

/* From now on no item can join. */
static void close_job(struct bvhd_client *client, struct local_job *job)
{
    if (job->is_open)
        list_remove(&client->local.jobs, &job->link);
    job->is_open = false;
}

void local_builds_leave(struct client_item *item)
{
    struct local_job *job = item->local.job;
    list_remove(&job->waiters, &item->local.link);
    item->local.job = NULL;
    update_deadline(job);
    if (job->waiters.first)
        return;
    atomic_store_explicit(&job->cancel, true, memory_order_relaxed);
    close_job(item->local.batch->client, job);
}

static struct client_item *first_waiter(const struct local_job *job)
{
    return job->waiters.first ? container_of(job->waiters.first, struct client_item, local.link) : NULL;
}

static uint32_t index_of(const struct client_item *item)
{
    return (uint32_t)(item - item->local.batch->items);
}

static void fail_waiters(struct local_job *job)
{
    struct client_item *item;
    while ((item = first_waiter(job)))
        client_batch_fail_item(item->local.batch, index_of(item), &job->error);
}

/* Gives the waiters of a job the result that is held already. */
static void share_with_waiters(struct local_job *job, const struct client_item *held)
{
    struct client_item *item;
    while ((item = first_waiter(job)))
        share(item->local.batch, index_of(item), held);
}

static double ms_since(uint64_t moment)
{
    return (double)(clock_ns() - moment) / (double)LIBRARY_MS;
}

static void complete_waiters(struct bvhd_client *client, struct local_job *job)
{
    struct client_item *item;
    for (bool is_own = true; (item = first_waiter(job)); is_own = false) {
        struct bvhd_batch *batch = item->local.batch;
        struct control_result result;
        local_job_describe(job, is_own, &result);
        result.prepare_ms = item->local.prepare_ms;
        double rest = ms_since(batch->submitted_at) - result.prepare_ms - result.build_ms;
        result.queued_ms = rest > 0 ? rest : 0;
        client_batch_complete_item(batch, index_of(item), &result, bvhd_blob_ref(job->blob));
        list_result(client, item);
    }
}

static void move_waiters(struct local_job *from, struct local_job *to)
{
    struct client_item *item;
    while ((item = first_waiter(from))) {
        list_remove(&from->waiters, &item->local.link);
        join(to, item->local.batch, item);
    }
}

/* Ends the items whose deadline is why a job was cancelled. */
static void end_late_items(struct bvhd_client *client, const struct local_job *job)
{
    if (job->status == BVHD_CANCELLED)
        client_deadline_check(client, clock_ns());
}

/*
 * The lock is dropped during the build. An item with more time may join just when the job is cancelled because the time
 * of the others has run out: then it begins again.
 */
static void build_job(struct bvhd_client *client, struct local_job *job, const struct parallel *parallel)
{
    list_append(&client->local.jobs, &job->link);
    job->is_open = true;
    do {
        atomic_store_explicit(&job->cancel, false, memory_order_relaxed);
        client_unlock(client);
        local_job_build(job, parallel);
        client_lock(client);
        end_late_items(client, job);
    } while (job->status == BVHD_CANCELLED && job->waiters.first);
    close_job(client, job);
    if (job->status == BVHD_OK)
        complete_waiters(client, job);
    else
        fail_waiters(job);
}

/* After the preparation: answers the items of a job, or finds them another one, or builds. */
static void resolve_job(struct bvhd_client *client, struct local_job *job, const struct parallel *parallel)
{
    struct client_item *first = first_waiter(job);
    if (!first)
        return;
    first->local.prepare_ms = job->prepare_ms;
    if (job->status != BVHD_OK) {
        fail_waiters(job);
        return;
    }
    const struct client_item *held = local_results_find(&client->local.results, &job->entry.key);
    struct local_job *same = held ? NULL : find_job(client, &job->entry.key);
    if (held)
        share_with_waiters(job, held);
    else if (same)
        move_waiters(job, same);
    else
        build_job(client, job, parallel);
}

/* Copies payloads for which there is room now, or which depended on a result, and tells other threads. */
static void offer_work(struct bvhd_client *client)
{
    outgoing_pump(client);
    client_stir(client);
    local_builds_wake(client);
}

bool local_builds_run(struct bvhd_client *client, const struct parallel *parallel, const struct bvhd_batch *own)
{
    uint32_t index;
    struct bvhd_batch *batch = find_work(client, own, &index);
    struct local_job *job = batch ? start_job(batch, index) : NULL;
    if (!job)
        return batch != NULL;
    client_stir(client); /* another thread may have to poll now */
    client_unlock(client);
    local_job_prepare(job, parallel);
    client_lock(client);
    placement_release(&client->placement, &job->payload);
    end_late_items(client, job);
    offer_work(client);
    resolve_job(client, job, parallel);
    offer_work(client);
    client_unlock(client);
    local_job_destroy(job); /* freeing a large copy takes time */
    client_lock(client);
    return true;
}
