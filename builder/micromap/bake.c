/* SPDX-License-Identifier: Apache-2.0 */
/* bake.c - the steps of a bake: table of texels, different triangles, levels, states, sharing, result. */
#include "builder/micromap/bake.h"

#include <math.h>
#include <string.h>

#include "builder/micromap/bake_unique.h"
#include "builder/micromap/level_choice.h"
#include "builder/micromap/triangle_bake.h"

/* Triangles are handed to threads so many at once; at high levels, where each takes long, one by one. */
enum { TRIANGLES_A_TASK = 32, LEVEL_OF_SINGLE_TASKS = 6, TRIANGLES_MAX = 1 << 29 };

struct job {
    const struct bake_request *request;
    const struct build_context *context;
    struct alpha_cells cells;
    struct triangle_baker baker;
    struct bake_uniques uniques;
    struct level_facts *facts; /* of AUTO */
    unsigned char *data;
    uint64_t size;
    size_t chunk;
    atomic_bool is_unfinished;
};

static enum bvhd_status check(const struct bake_request *request, struct bvhd_error *error)
{
    if (request->format != MICRO_2_STATE && request->format != MICRO_4_STATE)
        return bvhd_error_set(error, BVHD_INVALID, "format", "the format is unknown");
    const uint32_t level = request->level == BAKE_LEVEL_AUTO ? request->last_level : request->level;
    if (level > MICRO_LEVEL_MAX)
        return bvhd_error_set(error, BVHD_INVALID, "level", "levels are at most %d", MICRO_LEVEL_MAX);
    if (request->level == BAKE_LEVEL_AUTO && !(request->worth >= 0))
        return bvhd_error_set(error, BVHD_INVALID, "worth", "the worth of a byte is at least 0");
    if (!(request->extra[0] >= 0 && request->extra[1] >= 0))
        return bvhd_error_set(error, BVHD_INVALID, "extra", "the extra distance is at least 0");
    if (request->triangle_count > TRIANGLES_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "triangles", "%u triangles are more than %d",
                              request->triangle_count, TRIANGLES_MAX);
    if (!request->coordinates && request->coordinate_count > 0)
        return bvhd_error_set(error, BVHD_INVALID, "coordinates", "there are no texture coordinates");
    return BVHD_OK;
}

static enum bvhd_status cancelled(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, "micromap", "cancelled");
}

/* Runs a task over all different triangles, in chunks. */
static enum bvhd_status run(struct job *job, unsigned level, parallel_task task, struct bvhd_error *error)
{
    job->chunk = level < LEVEL_OF_SINGLE_TASKS ? TRIANGLES_A_TASK : 1;
    const size_t tasks = parallel_chunks(job->chunk, job->uniques.count);
    const bool is_done = parallel_for_until(job->context->parallel, job->context->cancel, tasks, task, job);
    return is_done && !atomic_load(&job->is_unfinished) ? BVHD_OK : cancelled(error);
}

/* A fixed level is for the triangles of which no single state is certain; the others have level 0. */
static void choose_fixed(void *context, size_t index)
{
    struct job *job = context;
    size_t begin, end;
    parallel_chunk(index, job->chunk, job->uniques.count, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        struct bake_unique *item = &job->uniques.items[i];
        struct texture_triangle triangle;
        texture_triangle_init(&job->cells, (const float(*)[2])item->coordinates, job->request->extra, 0, &triangle);
        const unsigned seen = triangle_bake_whole(&job->baker, &triangle);
        const bool is_one = seen == ALPHA_PASSES || seen == ALPHA_FAILS || triangle.is_everywhere;
        item->level = is_one ? 0 : (unsigned char)job->request->level;
    }
}

static void explore(void *context, size_t index)
{
    struct job *job = context;
    const struct bake_request *request = job->request;
    size_t begin, end;
    parallel_chunk(index, job->chunk, job->uniques.count, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        const struct bake_unique *item = &job->uniques.items[i];
        struct texture_triangle triangle;
        texture_triangle_init(&job->cells, (const float(*)[2])item->coordinates, request->extra, request->last_level,
                              &triangle);
        const double worth = item->weight > 0 ? request->worth * MICRO_COUNT_MAX / item->weight : INFINITY;
        job->facts[i].weight = item->weight;
        if (!triangle_bake_explore(&job->baker, &triangle, request->format, request->last_level, worth,
                                   job->facts[i].decided))
            atomic_store(&job->is_unfinished, true);
    }
}

static enum bvhd_status choose_auto(struct job *job, struct bvhd_error *error)
{
    struct memory *memory = job->context->memory;
    const size_t count = job->uniques.count;
    unsigned char *levels = memory_alloc(memory, count);
    job->facts = memory_array(memory, count, sizeof *job->facts);
    enum bvhd_status status = BVHD_OK;
    if (count > 0 && (!levels || !job->facts))
        status = bvhd_error_no_memory(error, "levels", "no memory for what %zu triangles decide", count);
    if (status == BVHD_OK)
        status = run(job, MICRO_LEVEL_MAX, explore, error);
    if (status == BVHD_OK) {
        const struct level_limits limits = {.format = job->request->format,
                                            .last = job->request->last_level,
                                            .worth = job->request->worth,
                                            .budget = job->request->budget};
        status = level_choice_make(job->facts, count, &limits, job->context, levels, error);
    }
    for (size_t i = 0; status == BVHD_OK && i < count; i++)
        job->uniques.items[i].level = levels[i];
    memory_free(memory, job->facts);
    memory_free(memory, levels);
    job->facts = NULL;
    return status;
}

/* Gives each triangle that has a level its place in the data. */
static enum bvhd_status place_states(struct job *job, struct bvhd_error *error)
{
    for (uint32_t i = 0; i < job->uniques.count; i++) {
        struct bake_unique *item = &job->uniques.items[i];
        item->offset = job->size;
        if (item->level > 0)
            job->size += micro_triangle_bytes(job->request->format, item->level);
    }
    job->data = memory_alloc(job->context->memory, job->size);
    if (!job->data && job->size > 0)
        return bvhd_error_no_memory(error, "micromap", "no memory for %llu bytes of states",
                                    (unsigned long long)job->size);
    return BVHD_OK;
}

/* Sets the special index of a triangle whose micro-triangles all have one state. */
static void find_special(struct bake_unique *item)
{
    item->index = 0;
    for (int state = 0; state < MICRO_STATES; state++)
        if (item->counts[state] == micro_triangle_count(item->level))
            item->index = ~state;
}

static void bake_chunk(void *context, size_t index)
{
    struct job *job = context;
    const enum micro_format format = job->request->format;
    size_t begin, end;
    parallel_chunk(index, job->chunk, job->uniques.count, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        struct bake_unique *item = &job->uniques.items[i];
        struct texture_triangle triangle;
        unsigned char single, *states = item->level > 0 ? job->data + item->offset : &single;
        texture_triangle_init(&job->cells, (const float(*)[2])item->coordinates, job->request->extra, item->level,
                              &triangle);
        if (!triangle_bake_states(&job->baker, &triangle, format, item->level, states, item->counts))
            atomic_store(&job->is_unfinished, true);
        find_special(item);
        item->hash = item->index < 0 ? 0 : bake_unique_hash(states, micro_triangle_bytes(format, item->level));
    }
}

/* Adds the mesh's triangles that are like an item. */
static void add_statistics(const struct bake_unique *item, double total, struct bake_statistics *statistics)
{
    const double micros = micro_triangle_count(item->level);
    for (int state = 0; state < MICRO_STATES; state++) {
        statistics->shares[state] += total > 0 ? item->counts[state] / micros * (item->weight / total) : 0;
        if (item->index == ~state)
            statistics->special[state] += item->uses;
        if (item->index >= 0)
            statistics->micros[state] += (uint64_t)item->counts[state] * item->uses;
    }
}

/* Fills the result from the items, whose states are at their final places. */
static void fill(const struct job *job, struct baked *baked)
{
    const struct bake_uniques *uniques = &job->uniques;
    uint32_t next = 0;
    double total = 0;
    for (uint32_t i = 0; i < uniques->count; i++)
        total += uniques->items[i].weight;
    for (uint32_t i = 0; i < uniques->count; i++) {
        const struct bake_unique *item = &uniques->items[i];
        add_statistics(item, total, &baked->statistics);
        if (item->index >= 0)
            baked->references[item->level] += item->uses;
        if (item->index != (int32_t)next)
            continue;
        baked->triangles[next++] = (struct micromap_triangle){
            .offset = (uint32_t)item->offset, .level = item->level, .format = (uint16_t)job->request->format};
        baked->usages[item->level]++;
        for (int state = 0; state < MICRO_STATES; state++)
            baked->statistics.states[state] += item->counts[state];
    }
    for (uint32_t i = 0; i < job->request->triangle_count; i++)
        baked->indices[i] = (uint32_t)uniques->items[uniques->of[i]].index;
    baked->statistics.decided =
        job->request->format == MICRO_2_STATE && total > 0
            ? 1
            : baked->statistics.shares[MICRO_TRANSPARENT] + baked->statistics.shares[MICRO_OPAQUE];
}

/* Shares equal states, and makes the result of them. */
static enum bvhd_status finish_job(struct job *job, struct baked *ret_baked, struct bvhd_error *error)
{
    struct memory *memory = job->context->memory;
    struct baked baked = {0};
    enum bvhd_status status = bake_unique_share(&job->uniques, job->request->format, job->data, job->context,
                                                &baked.data_size, &baked.triangle_count, error);
    if (status != BVHD_OK)
        return status;
    if (baked.data_size > UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "micromap", "%llu bytes of states are more than offsets reach",
                              (unsigned long long)baked.data_size);
    baked.triangles = memory_array(memory, baked.triangle_count, sizeof *baked.triangles);
    baked.indices = memory_array(memory, job->request->triangle_count, sizeof *baked.indices);
    baked.data = memory_resize(memory, job->data, baked.data_size);
    if (baked.data || baked.data_size == 0) {
        if (!baked.data)
            memory_free(memory, job->data);
        job->data = NULL;
    }
    if ((!baked.data && baked.data_size > 0) || (!baked.triangles && baked.triangle_count > 0) ||
        (!baked.indices && job->request->triangle_count > 0)) {
        bake_finish(&baked, memory);
        return bvhd_error_no_memory(error, "micromap", "no memory for the result");
    }
    fill(job, &baked);
    *ret_baked = baked;
    return BVHD_OK;
}

static enum bvhd_status run_job(struct job *job, struct baked *ret_baked, struct bvhd_error *error)
{
    const bool is_auto = job->request->level == BAKE_LEVEL_AUTO;
    const unsigned last = is_auto ? job->request->last_level : job->request->level;
    enum bvhd_status status = bake_unique_gather(job->request, job->context, &job->uniques, error);
    if (status != BVHD_OK)
        return status;
    status = is_auto ? choose_auto(job, error) : run(job, 0, choose_fixed, error);
    if (status == BVHD_OK)
        status = place_states(job, error);
    if (status == BVHD_OK)
        status = run(job, last, bake_chunk, error);
    if (status == BVHD_OK)
        status = finish_job(job, ret_baked, error);
    memory_free(job->context->memory, job->data);
    bake_unique_finish(&job->uniques, job->context->memory);
    return status;
}

enum bvhd_status bake(const struct bake_request *request, const struct build_context *context, struct baked *ret_baked,
                      struct bvhd_error *error)
{
    enum bvhd_status status = check(request, error);
    if (status != BVHD_OK)
        return status;
    struct job job = {.request = request, .context = context};
    status = alpha_cells_init(&request->texture, context, &job.cells, error);
    if (status != BVHD_OK)
        return status;
    job.baker = (struct triangle_baker){.cells = &job.cells, .cancel = context->cancel};
    status = run_job(&job, ret_baked, error);
    alpha_cells_finish(&job.cells, context->memory);
    return status;
}

void bake_finish(struct baked *baked, struct memory *memory)
{
    memory_free(memory, baked->triangles);
    memory_free(memory, baked->data);
    memory_free(memory, baked->indices);
    *baked = (struct baked){0};
}
