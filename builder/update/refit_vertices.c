/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/refit_vertices.h"

#include "builder/format/portable_records.h"
#include "proto/base/prefix.h"

enum { COPY_CHUNK = 8192, MARK_CHUNK = 8192 };

struct vertices {
    const struct record_kind *kind;
    const struct canonical *canonical;
    const struct record *record;
    float *written; /* the vertices of the result */
    uint8_t *used; /* for each vertex: 1 if an active primitive uses it; NULL: all are kept */
    uint32_t *first_kept; /* for each chunk of vertices: how many are kept before it */
};

static void copy_chunk(void *context, size_t index)
{
    const struct vertices *vertices = context;
    const struct canonical *canonical = vertices->canonical;
    size_t begin, end;
    parallel_chunk(index, COPY_CHUNK, canonical->vertex_count, &begin, &end);
    const size_t first = vertices->used ? vertices->first_kept[index] : begin;
    float *to = vertices->written + vertices->kind->vertex_size / sizeof *to * first;
    const struct canonical_geometry *geometry =
        canonical->geometries + prefix_find(&canonical->geometries[0].first_vertex, sizeof canonical->geometries[0],
                                            canonical->geometry_count, begin);
    for (; begin < end; geometry++) {
        size_t limit = (size_t)geometry->first_vertex + geometry->vertex_count;
        limit = limit < end ? limit : end;
        if (begin < limit)
            to = vertices->kind->copy_vertices(geometry, (uint32_t)begin - geometry->first_vertex,
                                               (uint32_t)(limit - begin),
                                               vertices->used ? vertices->used + begin : NULL, to);
        begin = limit;
    }
}

static void mark_chunk(void *context, size_t index)
{
    const struct vertices *vertices = context;
    uint32_t active[MARK_CHUNK], count = 0;
    size_t begin, end;
    parallel_chunk(index, MARK_CHUNK, vertices->canonical->primitive_count, &begin, &end);
    if (!vertices->record->active) {
        portable_records_mark_range(vertices->kind, vertices->canonical, (uint32_t)begin, (uint32_t)(end - begin),
                                    vertices->used);
        return;
    }
    for (size_t id = begin; id < end; id++) {
        active[count] = (uint32_t)id;
        count += record_is_active(vertices->record, (uint32_t)id);
    }
    vertices->kind->mark(vertices->canonical, active, count, vertices->used);
}

static void count_chunk(void *context, size_t index)
{
    const struct vertices *vertices = context;
    size_t i, end;
    uint32_t kept = 0;
    for (parallel_chunk(index, COPY_CHUNK, vertices->canonical->vertex_count, &i, &end); i < end; i++)
        kept += vertices->used[i];
    vertices->first_kept[index] = kept;
}

/* Replaces the counts of the chunks by their sums; returns the last one. */
static uint32_t sum_counts(uint32_t *counts, size_t chunks)
{
    uint32_t sum = 0;
    for (size_t i = 0; i < chunks; i++) {
        const uint32_t count = counts[i];
        counts[i] = sum;
        sum += count;
    }
    return sum;
}

static enum bvhd_status report_cancelled(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, "blob", "cancelled");
}

static enum bvhd_status report_corrupt(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CORRUPT, "body.vertexCount", "not as many as active primitives use");
}

static bool run(struct vertices *vertices, const struct build_context *context, size_t chunk, size_t total,
                parallel_task task)
{
    return parallel_for_until(context->parallel, context->cancel, parallel_chunks(chunk, total), task, vertices);
}

static enum bvhd_status copy_used(struct vertices *vertices, const struct build_context *context, uint32_t count,
                                  struct bvhd_error *error)
{
    const uint32_t all = vertices->canonical->vertex_count;
    memset(vertices->used, 0, all);
    if (!run(vertices, context, MARK_CHUNK, vertices->canonical->primitive_count, mark_chunk) ||
        !run(vertices, context, COPY_CHUNK, all, count_chunk))
        return report_cancelled(error);
    if (sum_counts(vertices->first_kept, parallel_chunks(COPY_CHUNK, all)) != count)
        return report_corrupt(error);
    return run(vertices, context, COPY_CHUNK, all, copy_chunk) ? BVHD_OK : report_cancelled(error);
}

static enum bvhd_status copy_kept(struct vertices *vertices, const struct build_context *context, uint32_t count,
                                  struct bvhd_error *error)
{
    const uint32_t all = vertices->canonical->vertex_count;
    vertices->used = memory_alloc(context->memory, all);
    vertices->first_kept =
        memory_array(context->memory, parallel_chunks(COPY_CHUNK, all), sizeof *vertices->first_kept);
    enum bvhd_status status = vertices->used && vertices->first_kept
                                  ? copy_used(vertices, context, count, error)
                                  : bvhd_error_no_memory(error, "vertices", "no memory for a table of %u", all);
    memory_free(context->memory, vertices->used);
    memory_free(context->memory, vertices->first_kept);
    return status;
}

enum bvhd_status refit_vertices(const struct record_kind *kind, const struct canonical *canonical,
                                const struct record *record, const struct build_context *context, float *vertices,
                                uint32_t count, struct bvhd_error *error)
{
    struct vertices all = {.kind = kind, .canonical = canonical, .record = record, .written = vertices};
    if (count == 0)
        return BVHD_OK;
    if (count > canonical->vertex_count)
        return report_corrupt(error);
    if (count < canonical->vertex_count)
        return copy_kept(&all, context, count, error);
    return run(&all, context, COPY_CHUNK, count, copy_chunk) ? BVHD_OK : report_cancelled(error);
}
