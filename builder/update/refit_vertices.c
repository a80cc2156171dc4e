/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/refit_vertices.h"

#include "proto/base/prefix.h"

enum { COPY_CHUNK = 8192, NAME_CHUNK = 8192 };

#define NO_VERTEX UINT32_MAX

struct vertices {
    const struct canonical *canonical;
    const struct portable_view *source;
    float *positions; /* of the result */
    uint32_t *names; /* the vertex of the canonical copy in each row; NULL: row i is vertex i */
    atomic_bool is_corrupt;
};

/* Returns the last geometry that starts at or before a vertex; it is never one without vertices. */
static const struct canonical_geometry *geometry_of(const struct canonical *canonical, uint64_t vertex)
{
    return &canonical->geometries[prefix_find(&canonical->geometries[0].first_vertex, sizeof canonical->geometries[0],
                                              canonical->geometry_count, vertex)];
}

static void copy_all(void *context, size_t index)
{
    const struct vertices *vertices = context;
    size_t begin, end;
    parallel_chunk(index, COPY_CHUNK, vertices->source->header->vertex_count, &begin, &end);
    const struct canonical_geometry *geometry = geometry_of(vertices->canonical, begin);
    for (; begin < end; geometry++) {
        size_t limit = (size_t)geometry->first_vertex + geometry->vertex_count;
        limit = limit < end ? limit : end;
        if (begin < limit)
            memcpy(vertices->positions + 3 * begin, geometry->positions + 3 * (begin - geometry->first_vertex),
                   12 * (limit - begin));
        begin = limit;
    }
}

static void copy_named(void *context, size_t index)
{
    const struct vertices *vertices = context;
    const struct canonical *canonical = vertices->canonical;
    const struct canonical_geometry *geometry = canonical->geometries;
    size_t row, end;
    for (parallel_chunk(index, COPY_CHUNK, vertices->source->header->vertex_count, &row, &end); row < end; row++) {
        const uint32_t vertex = vertices->names[row];
        if (vertex == NO_VERTEX) {
            memset(vertices->positions + 3 * row, 0, 12);
            continue;
        }
        if (vertex - geometry->first_vertex >= geometry->vertex_count)
            geometry = geometry_of(canonical, vertex);
        memcpy(vertices->positions + 3 * row, geometry->positions + (size_t)3 * (vertex - geometry->first_vertex), 12);
    }
}

/* Returns corner `k` of a triangle in the numbering over all geometries. */
static uint32_t vertex_of(const struct canonical_geometry *geometry, uint32_t triangle, unsigned k)
{
    const size_t corner = (size_t)3 * triangle + k;
    return geometry->first_vertex + (geometry->indices ? geometry->indices[corner] : (uint32_t)corner);
}

/* Several records name the same row; they store the same vertex there. */
static void find_names(void *context, size_t index)
{
    struct vertices *vertices = context;
    const struct canonical *canonical = vertices->canonical;
    const struct portable_header *header = vertices->source->header;
    const struct portable_indexed_triangle *records = vertices->source->records;
    const struct canonical_geometry *geometry = canonical->geometries;
    size_t i, end;
    for (parallel_chunk(index, NAME_CHUNK, header->record_count, &i, &end); i < end; i++) {
        const uint32_t id = records[i].id & PORTABLE_ID_MASK, *rows = records[i].vertices;
        if (id >= canonical->primitive_count || rows[0] >= header->vertex_count || rows[1] >= header->vertex_count ||
            rows[2] >= header->vertex_count) {
            atomic_store_explicit(&vertices->is_corrupt, true, memory_order_relaxed);
            continue;
        }
        if (id - geometry->first_primitive >= geometry->primitive_count)
            geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
        for (unsigned k = 0; k < 3; k++)
            __atomic_store_n(&vertices->names[rows[k]], vertex_of(geometry, id - geometry->first_primitive, k),
                             __ATOMIC_RELAXED);
    }
}

static bool run(struct vertices *vertices, const struct build_context *context, size_t chunk, size_t total,
                parallel_task task)
{
    return parallel_for_until(context->parallel, context->cancel, parallel_chunks(chunk, total), task, vertices);
}

static enum bvhd_status copy_kept(struct vertices *vertices, const struct build_context *context,
                                  struct bvhd_error *error)
{
    const struct portable_header *header = vertices->source->header;
    vertices->names = memory_array(context->memory, header->vertex_count, sizeof *vertices->names);
    if (!vertices->names)
        return bvhd_error_no_memory(error, "vertices", "no memory for the names of %u", header->vertex_count);
    memset(vertices->names, 0xff, (size_t)header->vertex_count * sizeof *vertices->names);
    bool finished = run(vertices, context, NAME_CHUNK, header->record_count, find_names) &&
                    run(vertices, context, COPY_CHUNK, header->vertex_count, copy_named);
    memory_free(context->memory, vertices->names);
    if (!finished)
        return bvhd_error_set(error, BVHD_CANCELLED, "blob", "cancelled");
    return atomic_load_explicit(&vertices->is_corrupt, memory_order_relaxed)
               ? bvhd_error_set(error, BVHD_CORRUPT, "records", "an id or a vertex is out of range")
               : BVHD_OK;
}

enum bvhd_status refit_vertices(const struct canonical *canonical, const struct portable_view *source,
                                const struct build_context *context, float *vertices, struct bvhd_error *error)
{
    struct vertices all = {.canonical = canonical, .source = source, .positions = vertices};
    const uint32_t count = source->header->vertex_count;
    if (count == 0)
        return BVHD_OK;
    if (count > canonical->vertex_count)
        return bvhd_error_set(error, BVHD_CORRUPT, "body.vertexCount", "more vertices than the geometry has");
    if (count < canonical->vertex_count)
        return copy_kept(&all, context, error);
    return run(&all, context, COPY_CHUNK, count, copy_all) ? BVHD_OK
                                                           : bvhd_error_set(error, BVHD_CANCELLED, "blob", "cancelled");
}
