/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle works in two passes. For each ray and each block of primitives, the first one (oracle_filter.h) drops
 * nearly all primitives by the distance between the ray's line and their bounding spheres. The second one
 * (oracle_kind.h) tests the others, and oracle_pursuit.h collects the hits of a ray. Chunks of rays are
 * independent: each goes through all primitives.
 */
#include "client/bvhctl/oracle/oracle.h"

#include <math.h>
#include <stdatomic.h>

#include "client/bvhctl/oracle/oracle_filter.h"
#include "client/bvhctl/oracle/oracle_kind.h"
#include "client/bvhctl/oracle/oracle_pursuit.h"
#include "proto/base/status.h"

/* Rays that go through the primitives together: as many as fit into a cache, but fewer if threads would be idle. */
enum { MOST_RAYS = 512, FEWEST_RAYS = 16, PROGRESS_BLOCKS = 64 };

struct trace {
    const struct oracle_mesh *meshes;
    uint32_t mesh_count;
    const struct ray *rays;
    uint32_t ray_count;
    bool moves; /* something does, so that the time of rays matters */
    size_t chunk; /* rays */
    struct memory *memory;
    void (*progress)(void *context, uint64_t done, uint64_t total);
    void *progress_context;
    uint64_t total;
    _Atomic uint64_t done;
    atomic_bool failed;
    struct oracle_answer *answers;
};

/* ---- primitives, in blocks over all meshes ---- */

static const struct oracle_kind *const kinds[ORACLE_SHAPES] = {
    [ORACLE_TRIANGLES] = &oracle_triangles,
    [ORACLE_SPHERES] = &oracle_spheres,
    [ORACLE_SWEPT_SPHERES] = &oracle_swept_spheres,
};

struct primitive_block {
    struct oracle_filter_block filter;
    const struct oracle_kind *kinds[ORACLE_FILTER_BLOCK];
    union oracle_subject subjects[ORACLE_FILTER_BLOCK];
    struct oracle_moment moments[ORACLE_FILTER_BLOCK]; /* to which subjects refer: one for each mesh */
    uint32_t moment_count;
    struct oracle_primitive_id ids[ORACLE_FILTER_BLOCK];
};

struct primitive_cursor {
    uint32_t mesh, primitive;
};

static void block_add(struct primitive_block *block, const struct oracle_moment *moment, uint32_t primitive)
{
    const struct oracle_mesh *mesh = moment->mesh;
    uint32_t at = block->filter.count;
    const struct oracle_kind *kind = kinds[mesh->shape];
    double centre[3], radius;
    if (!kind->fetch(moment, primitive, &block->subjects[at]))
        return;
    kind->sphere(&block->subjects[at], centre, &radius);
    block->kinds[at] = kind;
    block->ids[at] = (struct oracle_primitive_id){mesh->instance, mesh->geometry, primitive, 1, 0};
    oracle_filter_add(&block->filter, centre, radius);
}

/*
 * Fills the block with the next primitives that can be hit at that time. Returns how many primitives were read; 0 at
 * the end.
 */
static uint64_t block_fill(const struct trace *trace, struct primitive_cursor *cursor, float time, double wobble,
                           struct primitive_block *ret_block)
{
    uint64_t seen = 0;
    oracle_filter_begin(&ret_block->filter, wobble);
    ret_block->moment_count = 0;
    for (; cursor->mesh < trace->mesh_count; cursor->mesh++, cursor->primitive = 0) {
        const struct oracle_mesh *mesh = &trace->meshes[cursor->mesh];
        const uint32_t before = ret_block->filter.count;
        if (before == ORACLE_FILTER_BLOCK)
            return seen;
        struct oracle_moment *moment = &ret_block->moments[ret_block->moment_count];
        if (!oracle_moment_make(mesh, time, moment)) {
            seen += mesh->primitive_count - cursor->primitive;
            continue;
        }
        for (; cursor->primitive < mesh->primitive_count; cursor->primitive++, seen++) {
            if (ret_block->filter.count == ORACLE_FILTER_BLOCK)
                return seen;
            block_add(ret_block, moment, cursor->primitive);
        }
        ret_block->moment_count += ret_block->filter.count > before;
    }
    return seen;
}

/* ---- a chunk of rays against all primitives ---- */

struct ray_chunk {
    uint32_t count;
    float time; /* of all its rays, if something moves */
    double wobble; /* the largest of all its rays (oracle_filter.h) */
    struct oracle_pursuit *pursuits;
    struct oracle_filter_ray *filters;
    struct primitive_block *block;
};

static bool chunk_init(struct ray_chunk *chunk, const struct ray *rays, uint32_t count, struct memory *memory)
{
    *chunk = (struct ray_chunk){.count = count, .time = rays->time};
    chunk->pursuits = memory_array(memory, count, sizeof *chunk->pursuits);
    chunk->filters = memory_array(memory, count, sizeof *chunk->filters);
    chunk->block = memory_alloc(memory, sizeof *chunk->block);
    for (uint32_t i = 0; chunk->pursuits && i < count; i++) {
        struct oracle_pursuit *pursuit = &chunk->pursuits[i];
        oracle_pursuit_init(pursuit, &rays[i]);
        if (pursuit->kind == ORACLE_RAY_GOOD && chunk->filters)
            chunk->wobble = fmax(chunk->wobble, oracle_filter_ray_init(&chunk->filters[i], &rays[i]));
    }
    return chunk->pursuits && chunk->filters && chunk->block;
}

static void chunk_finish(struct ray_chunk *chunk, struct memory *memory)
{
    for (uint32_t i = 0; chunk->pursuits && i < chunk->count; i++)
        oracle_pursuit_finish(&chunk->pursuits[i], memory);
    memory_free(memory, chunk->pursuits);
    memory_free(memory, chunk->filters);
    memory_free(memory, chunk->block);
}

/* Tests the ray against one primitive of the block. Returns false when there is no memory. */
static bool meet(struct oracle_pursuit *pursuit, const struct primitive_block *block, uint32_t at,
                 struct memory *memory)
{
    struct oracle_contender next = {.id = block->ids[at]};
    struct oracle_outline outline;
    enum oracle_presence presence =
        block->kinds[at]->meet(&pursuit->ray, &block->subjects[at], &next.crossing, &outline);
    return presence == ORACLE_ABSENT || oracle_pursuit_note(pursuit, presence, &next, &outline, memory);
}

static bool chunk_meet_block(struct ray_chunk *chunk, struct memory *memory)
{
    struct primitive_block *block = chunk->block;
    uint16_t near[ORACLE_FILTER_BLOCK];
    for (uint32_t i = 0; i < chunk->count; i++) {
        struct oracle_pursuit *pursuit = &chunk->pursuits[i];
        if (pursuit->kind == ORACLE_RAY_VAGUE && block->filter.count)
            pursuit->doubt_low = -INFINITY;
        if (pursuit->kind != ORACLE_RAY_GOOD)
            continue;
        uint32_t near_count = oracle_filter_scan(&block->filter, &chunk->filters[i], near);
        for (uint32_t k = 0; k < near_count; k++)
            if (!meet(pursuit, block, near[k], memory))
                return false;
    }
    return true;
}

static void report(struct trace *trace, uint64_t pairs)
{
    uint64_t done = atomic_fetch_add(&trace->done, pairs) + pairs;
    if (trace->progress && pairs)
        trace->progress(trace->progress_context, done, trace->total);
}

static bool chunk_walk(struct ray_chunk *chunk, struct trace *trace)
{
    struct primitive_cursor cursor = {0};
    uint64_t seen, pairs = 0;
    uint32_t blocks = 0;
    while ((seen = block_fill(trace, &cursor, chunk->time, chunk->wobble, chunk->block))) {
        if (atomic_load(&trace->failed) || !chunk_meet_block(chunk, trace->memory))
            return false;
        pairs += seen * chunk->count;
        if (++blocks % PROGRESS_BLOCKS == 0) {
            report(trace, pairs);
            pairs = 0;
        }
    }
    report(trace, pairs);
    return true;
}

/* Traces rays of one time. */
static bool trace_run(struct trace *trace, size_t begin, size_t end)
{
    struct ray_chunk chunk;
    bool done =
        chunk_init(&chunk, trace->rays + begin, (uint32_t)(end - begin), trace->memory) && chunk_walk(&chunk, trace);
    for (size_t i = begin; done && i < end; i++)
        done = oracle_pursuit_answer(&chunk.pursuits[i - begin], trace->memory, &trace->answers[i]);
    chunk_finish(&chunk, trace->memory);
    return done;
}

static void trace_chunk(void *context, size_t index)
{
    struct trace *trace = context;
    size_t begin, end, next;
    parallel_chunk(index, trace->chunk, trace->ray_count, &begin, &end);
    for (; begin < end; begin = next) {
        next = trace->moves ? begin + 1 : end;
        while (next < end && trace->rays[next].time == trace->rays[begin].time)
            next++;
        if (!trace_run(trace, begin, next)) {
            atomic_store(&trace->failed, true);
            return;
        }
    }
}

enum bvhd_status oracle_trace(const struct oracle_mesh *meshes, uint32_t mesh_count, const struct ray *rays,
                              uint32_t ray_count, struct memory *memory, const struct parallel *parallel,
                              void (*progress)(void *context, uint64_t done, uint64_t total), void *progress_context,
                              struct oracle_answer *ret_answers, struct bvhd_error *error)
{
    struct trace trace = {
        .meshes = meshes, .mesh_count = mesh_count, .rays = rays, .ray_count = ray_count, .memory = memory};
    size_t share = ray_count / parallel->threads + 1;
    trace.chunk = share > MOST_RAYS ? MOST_RAYS : share < FEWEST_RAYS ? FEWEST_RAYS : share;
    trace.moves = oracle_moves(meshes, mesh_count);
    trace.progress = progress;
    trace.progress_context = progress_context;
    trace.answers = ret_answers;
    for (uint32_t i = 0; i < mesh_count; i++)
        trace.total += (uint64_t)meshes[i].primitive_count * ray_count;
    for (uint32_t i = 0; i < ray_count; i++)
        ret_answers[i] = (struct oracle_answer){.outcome = ORACLE_MISS};
    parallel_for(parallel, parallel_chunks(trace.chunk, ray_count), trace_chunk, &trace);
    if (!atomic_load(&trace.failed))
        return BVHD_OK;
    oracle_finish(ret_answers, ray_count, memory);
    return bvhd_error_no_memory(error, "rays", "no memory to trace %u rays by brute force", ray_count);
}

void oracle_finish(struct oracle_answer *answers, uint32_t ray_count, struct memory *memory)
{
    for (uint32_t i = 0; answers && i < ray_count; i++) {
        memory_free(memory, answers[i].tied);
        answers[i] = (struct oracle_answer){.outcome = ORACLE_MISS};
    }
}

/* ---- judging ---- */

static const struct oracle_primitive_id *find_tied(const struct oracle_answer *answer, const struct ray_hit *hit)
{
    for (uint32_t i = 0; i < answer->tied_count; i++) {
        const struct oracle_primitive_id *id = &answer->tied[i];
        if (id->instance == hit->instance && id->geometry == hit->geometry &&
            hit->primitive - id->primitive < id->count)
            return id;
    }
    return NULL;
}

/* Returns whether t is within the bounds, with a tolerance for traversal that computes in float. */
static bool is_possible_t(const struct oracle_answer *answer, double t)
{
    double slack = 8 * FLT_EPSILON * fmax(fabs(answer->t_low), fabs(answer->t_end)) + FLT_TRUE_MIN;
    return t >= answer->t_low - slack && t <= answer->t_end + slack;
}

enum oracle_verdict oracle_judge(const struct oracle_answer *answer, const struct ray_hit *hit, double *ret_t_rel_err)
{
    if (ret_t_rel_err)
        *ret_t_rel_err = 0;
    if (answer->outcome == ORACLE_UNCERTAIN)
        return ORACLE_UNDECIDED;
    if (answer->outcome == ORACLE_MISS)
        return hit ? ORACLE_WRONG_HIT : ORACLE_RIGHT;
    if (!hit)
        return ORACLE_WRONG_MISS;
    const struct oracle_primitive_id *tied = hit->is_aabb ? NULL : find_tied(answer, hit);
    if (!tied)
        return ORACLE_WRONG_PRIMITIVE;
    if (!is_possible_t(answer, hit->t))
        return ORACLE_WRONG_HIT;
    if (ret_t_rel_err)
        *ret_t_rel_err = fabs(hit->t - tied->t) / fmax(fabs(tied->t), FLT_TRUE_MIN);
    return ORACLE_RIGHT;
}
