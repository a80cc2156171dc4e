/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/session/item_internal.h"

#include "proto/base/clock.h"
#include "proto/base/container_of.h"
#include "proto/base/place.h"

/* ---- waiting for memory ---- */

static bool is_possible(struct item *item, struct bvhd_error *error)
{
    uint64_t limit = item_service(item)->admission.memory[ADMISSION_LARGE]->limit;
    if (item->memory.claim.bytes <= limit)
        return true;
    bvhd_error_set(error, BVHD_TOO_LARGE, place("infos[%u]", item->index).text,
                   "its canonical copy may take %llu bytes, of which the service has %llu",
                   (unsigned long long)item->memory.claim.bytes, (unsigned long long)limit);
    return false;
}

static void wait_for_memory(struct item *item)
{
    struct service *service = item_service(item);
    item_enter(item, ITEM_WAITING);
    item->times.queued_ns = clock_ns();
    item->memory.claim.class = admission_class_of(&service->admission, item->memory.claim.bytes);
    memory_queue_add(&service->preparing, &item->request->client->member.preparing, &item->memory);
}

/* ---- the end of a prepare ---- */

/* The rows claim more memory than was promised, so the item queues again. Meanwhile it holds no micromaps. */
static void claim_more(struct item *item)
{
    struct preparation *preparation = item->preparation;
    struct bvhd_error error;
    micromap_sources_keep(&preparation->micromaps, item_service(item)->cache);
    admission_end(&item_service(item)->admission.prepares[preparation->class], preparation->promised);
    admission_expect_end(&item_service(item)->admission, preparation->class, preparation->promised_build);
    item->memory.claim.bytes = preparation->needed;
    item->memory.claim.build = preparation->needed_build;
    if (is_possible(item, &error)) {
        wait_for_memory(item);
        return;
    }
    preparation_destroy(item_take_preparation(item));
    item_fail(item, &error);
}

/* Reduces the promises to what the canonical copy holds, and to what its build will take. */
static void trim_promise(struct item *item)
{
    struct preparation *preparation = item->preparation;
    struct admission *admission = &item_service(item)->admission;
    uint64_t build = preparation->status == BVHD_OK ? preparation_make_bytes(preparation) : 0;
    if (build < preparation->promised_build) {
        admission_expect_end(admission, preparation->class, preparation->promised_build);
        admission_expect(admission, preparation->class, build);
        preparation->promised_build = build;
    }
    uint64_t held = atomic_load_explicit(&preparation->memory.live, memory_order_relaxed) + sizeof *preparation;
    if (held >= preparation->promised)
        return;
    admission_shrink(&admission->prepares[preparation->class], preparation->promised - held);
    preparation->promised = held;
}

/* The item was cancelled while the worker had it. */
static void leave_worker(struct item *item)
{
    disposals_add(&item_service(item)->disposals, item_take_preparation(item));
    item_enter(item, ITEM_ANSWERED);
    item_note_prepared(item);
}

static void finish_preparing(struct item *item)
{
    struct service *service = item_service(item);
    struct preparation *preparation = item->preparation;
    item_note_prepared(item);
    trim_promise(item);
    if (preparation->updated.is_read)
        cache_put(service->cache, preparation->updated.blob);
    micromap_sources_keep(&preparation->micromaps, service->cache);
    service->counters.prepares_done += preparation->status == BVHD_OK;
    service->counters.prepares_failed += preparation->status != BVHD_OK;
    if (preparation->status == BVHD_OK) {
        item->key = preparation->entry.key;
        item_find_result(item);
        return;
    }
    struct bvhd_error error = preparation->error;
    disposals_add(&service->disposals, item_take_preparation(item));
    item_fail(item, &error);
}

static struct item *item_of_job(struct pool_job *job)
{
    return container_of(job, struct item, job);
}

static void prepare_run(struct pool_job *job, const struct parallel *parallel)
{
    preparation_run(item_of_job(job)->preparation, parallel, &job->cancel);
}

static void submit_prepare(struct item *item);

static void prepare_done(struct pool_job *job)
{
    struct item *item = item_of_job(job);
    struct request *request = item->request;
    if (job->ran) {
        item->times.threads_ms += (double)(job->started_ns - job->submitted_ns) * 1e-6;
        item->times.prepare_ms += (double)(job->ended_ns - job->started_ns) * 1e-6;
    }
    if (item->state == ITEM_LEAVING)
        leave_worker(item);
    else if (item->preparation->names_micromaps)
        submit_prepare(item);
    else if (item->preparation->needed > 0)
        claim_more(item);
    else
        finish_preparing(item);
    request_settle(request);
}

/* ---- the start of a prepare ---- */

/* The promise does not cover the struct, so this may still fail. */
static bool make_preparation(struct item *item)
{
    struct service *service = item_service(item);
    struct request *request = item->request;
    if (item->preparation)
        return true;
    item->preparation = preparation_create(&item->asked, item->index, &item->source, &service->memory);
    item->source = (struct preparation_source){0};
    if (!item->preparation)
        return false;
    item->preparation->batch = (struct preparation_batch){request->destinations, request->destination_count};
    item->preparation->limits = &service->options.limits;
    item->preparation->updated.disk = service->disk;
    item->preparation->micromaps.disk = service->disk;
    return true;
}

static void fail_to_start(struct item *item)
{
    struct request *request = item->request;
    const struct admission_claim *claim = &item->memory.claim;
    struct bvhd_error error;
    admission_end(&item_service(item)->admission.prepares[claim->class], claim->bytes);
    bvhd_error_no_memory(&error, place("infos[%u]", item->index).text, "no memory to prepare it");
    item_fail(item, &error);
    request_settle(request);
}

/* The micromaps that it names, if they have been listed, are held while the worker has it. */
static void submit_prepare(struct item *item)
{
    enum { BYTES_PER_PRIMITIVE = 384 }; /* that are prepared in the time that it takes to build one primitive */
    struct service *service = item_service(item);
    item->job = (struct pool_job){
        .run = prepare_run,
        .done = prepare_done,
        .flow = item->request->client->member.flow,
        .size = item->memory.claim.bytes / BYTES_PER_PRIMITIVE,
        .priority = 2 * item->request->priority,
    };
    micromap_sources_look_up(&item->preparation->micromaps, service->cache);
    service->counters.prepares_started++;
    pool_submit(service->pool, &item->job);
}

static struct item *item_of_memory(struct memory_waiter *waiter)
{
    return container_of(waiter, struct item, memory);
}

static void start_preparing(struct memory_waiter *waiter)
{
    struct item *item = item_of_memory(waiter);
    item->times.memory_ms += (double)(clock_ns() - item->times.queued_ns) * 1e-6;
    if (!make_preparation(item)) {
        fail_to_start(item);
        return;
    }
    item->preparation->promised = waiter->claim.bytes;
    item->preparation->class = waiter->claim.class;
    item->preparation->promised_build = waiter->claim.build;
    admission_expect(&item_service(item)->admission, waiter->claim.class, waiter->claim.build);
    preparation_account(item->preparation, item_service(item)->admission.memory[waiter->claim.class]);
    item_enter(item, ITEM_PREPARING);
    submit_prepare(item);
}

/* An update holds its source from its start on, so that an eviction does not matter. */
static void hold_source(void *context, struct blob *blob)
{
    struct item *item = context;
    item->source.updated = blob ? blob_ref(blob) : NULL;
}

void item_start(struct item *item)
{
    struct bvhd_error error;
    if (item->asked.mode == MODE_UPDATE)
        cache_get(item_service(item)->cache, &item->asked.source_key, hold_source, item);
    item->memory.start = start_preparing;
    item->memory.claim.bytes = preparation_guess(&item->asked);
    item->memory.claim.build = preparation_guess_build(&item->asked);
    item->memory.priority = item->request->priority;
    if (is_possible(item, &error))
        wait_for_memory(item);
    else
        item_refuse(item, &error);
}
