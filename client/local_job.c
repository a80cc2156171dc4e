/* SPDX-License-Identifier: Apache-2.0 */
#include "client/local_job.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>

#include "client/library.h"
#include "client/local_library.h"
#include "client/local_micromaps.h"
#include "proto/base/container_of.h"
#include "proto/base/place.h"
#include "proto/base/timed_parallel.h"
#include "proto/wire/rows.h"

struct local_job *local_job_create(const struct control_item *asked, uint32_t index, struct held *payload,
                                   const unsigned char *pool_bytes, struct bvhd_blob *source)
{
    struct local_job *job = memory_alloc(&library_memory, sizeof *job);
    if (!job)
        return NULL;
    memset(job, 0, sizeof *job);
    job->asked = *asked;
    job->index = index;
    job->payload = *payload;
    job->pool_bytes = pool_bytes;
    job->source = source;
    atomic_init(&job->deadline, LIBRARY_NEVER);
    memory_init_within(&job->memory, &library_memory, UINT64_MAX);
    *payload = (struct held){.kind = HELD_NOTHING, .descriptor = -1};
    return job;
}

void local_job_destroy(struct local_job *job)
{
    if (!job)
        return;
    if (job->library)
        job->library->entry_finish(&job->entry, &job->memory);
    local_micromaps_destroy(job->micromaps);
    bvhd_blob_unref(job->source);
    bvhd_blob_unref(job->blob);
    memory_free(&library_memory, job);
}

static struct build_context context_of(struct local_job *job, const struct parallel *parallel)
{
    return (struct build_context){.memory = &job->memory, .parallel = parallel, .cancel = &job->cancel};
}

/* Describes the source in *memory; NULL: there is none. */
static const struct build_entry_source *source_of(const struct local_job *job, struct build_entry_source *memory)
{
    if (!job->source)
        return NULL;
    *memory = (struct build_entry_source){{bvhd_blob_data(job->source), bvhd_blob_size(job->source)},
                                          result_blob_record(job->source)};
    return memory;
}

static enum bvhd_status make_copy(struct local_job *job, struct bytes payload, const struct parallel *parallel)
{
    const struct control_item *asked = &job->asked;
    struct build_context context = context_of(job, parallel);
    struct rows_shape shape = {asked->geometry_count, asked->geometry_size, asked->reference_count,
                               asked->reference_size, &job->cancel};
    struct build_input input = control_item_input(asked);
    struct build_entry_source source;
    enum bvhd_status status = rows_read(payload, &shape, job->index, &job->memory, &input, &job->error);
    if (status != BVHD_OK)
        return status;
    /* The rows are this job's own. */
    status = local_micromaps_give(job->micromaps, (struct reference *)(uintptr_t)input.references,
                                  input.reference_count, job->index, &job->error);
    if (status == BVHD_OK)
        status = job->library->entry_prepare(&input, job->index, source_of(job, &source), &context, &job->entry,
                                             &job->error);
    rows_finish(&input, &job->memory);
    return status;
}

static enum bvhd_status map_and_copy(struct local_job *job, const struct parallel *parallel)
{
    uint64_t size = job->payload.size;
    void *bytes = mmap(NULL, size, PROT_READ, MAP_SHARED, job->payload.descriptor, 0);
    if (bytes == MAP_FAILED)
        return bvhd_error_set(&job->error, errno == ENOMEM ? BVHD_NO_MEMORY : BVHD_IO,
                              place("infos[%u]", job->index).text, "mmap: %s", strerror(errno));
    enum bvhd_status status = make_copy(job, (struct bytes){bytes, size}, parallel);
    munmap(bytes, size);
    return status;
}

void local_job_prepare(struct local_job *job, const struct parallel *parallel)
{
    double begin = clock_ms();
    struct timed_parallel timed;
    timed_parallel_init(&timed, parallel, &job->deadline, &job->cancel);
    job->status = local_library_load(&job->library, &job->error);
    if (job->status != BVHD_OK)
        return;
    if (job->payload.kind == HELD_MEMFD)
        job->status = map_and_copy(job, &timed.parallel);
    else
        job->status = make_copy(job, (struct bytes){job->pool_bytes, job->payload.size}, &timed.parallel);
    local_micromaps_destroy(job->micromaps);
    job->micromaps = NULL;
    job->prepare_ms = clock_ms() - begin;
}

/* The memory of a blob, which outlives the job. */
struct blob_memory {
    struct build_output output;
    unsigned char *bytes;
    uint64_t size;
};

static unsigned char *allocate(struct build_output *output, uint64_t size)
{
    struct blob_memory *memory = container_of(output, struct blob_memory, output);
    memory->bytes = memory_alloc(&library_memory, size);
    memory->size = size;
    return memory->bytes;
}

static void discard(struct build_output *output, unsigned char *bytes)
{
    struct blob_memory *memory = container_of(output, struct blob_memory, output);
    memory_free(&library_memory, bytes);
    memory->bytes = NULL;
}

/* Runs on any thread of the build. Calls may overtake each other; who reads keeps the highest number. */
static void note_progress(void *context, uint64_t done, uint64_t total)
{
    struct local_job *job = context;
    uint32_t thousandths = total > 0 ? (uint32_t)((double)done / (double)total * CONTROL_DONE) : CONTROL_DONE;
    atomic_store_explicit(&job->thousandths, thousandths, memory_order_relaxed);
}

uint32_t local_job_thousandths(const struct local_job *job)
{
    uint32_t thousandths = atomic_load_explicit(&job->thousandths, memory_order_relaxed);
    return thousandths < CONTROL_DONE ? thousandths : CONTROL_DONE;
}

static enum bvhd_status make(struct local_job *job, const struct build_context *context)
{
    struct build_entry_source source;
    struct build_made made;
    const double begin = clock_ms();
    enum bvhd_status status =
        job->library->entry_make(&job->entry, source_of(job, &source), context, &made, &job->error);
    if (status != BVHD_OK)
        return status;
    job->summary = made.summary;
    job->summary.build_ms = clock_ms() - begin;
    return BVHD_OK;
}

void local_job_build(struct local_job *job, const struct parallel *parallel)
{
    struct blob_memory blob = {.output = {allocate, discard}};
    struct timed_parallel timed;
    timed_parallel_init(&timed, parallel, &job->deadline, &job->cancel);
    struct build_context context = context_of(job, &timed.parallel);
    struct memory memory;
    memory_init_within(&memory, &library_memory, UINT64_MAX);
    context.memory = &memory;
    context.output = &blob.output;
    context.progress = note_progress;
    context.progress_context = job;
    job->status = make(job, &context);
    if (job->status == BVHD_OK)
        job->status = result_blob_take(blob.bytes, blob.size, &job->blob, &job->error);
    if (job->status == BVHD_OK)
        job->status = result_blob_set_source(job->blob, &job->entry.key, job->entry.record.bytes, &job->error);
}

void local_job_describe(const struct local_job *job, bool is_own, struct control_result *ret_result)
{
    *ret_result = (struct control_result){
        .key = job->entry.key,
        .size = bvhd_blob_size(job->blob),
        .origin = is_own ? ORIGIN_BUILT : ORIGIN_COALESCED,
        .build_ms = is_own ? job->summary.build_ms : 0,
        .summary = job->summary,
    };
}
