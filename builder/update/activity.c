/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/activity.h"

#include "proto/base/prefix.h"

/* Vertices or primitives in a task: a multiple of 64. */
enum { CHUNK = 8192, INSTANCE_SIZE = 64, INSTANCE_REFERENCE = 56 };

struct search {
    const struct canonical *canonical;
    uint64_t *words;
    atomic_bool is_suspect; /* a value is NaN, or an instance has no reference */
    _Atomic uint32_t inactive;
};

static bool any_nan(const float *values, size_t count)
{
    int found = 0;
    for (size_t i = 0; i < count; i++)
        found |= values[i] != values[i];
    return found;
}

/* Looks for NaNs in a chunk of the vertices of all geometries. */
static void scan_vertices(void *context, size_t index)
{
    struct search *search = context;
    const struct canonical *canonical = search->canonical;
    size_t begin, end;
    bool found = false;
    parallel_chunk(index, CHUNK, canonical->vertex_count, &begin, &end);
    const struct canonical_geometry *geometry =
        canonical->geometries + prefix_find(&canonical->geometries[0].first_vertex, sizeof canonical->geometries[0],
                                            canonical->geometry_count, begin);
    for (; begin < end; geometry++) {
        size_t limit = (size_t)geometry->first_vertex + geometry->vertex_count;
        limit = limit < end ? limit : end;
        if (begin < limit)
            found |= any_nan(geometry->positions + 3 * (begin - geometry->first_vertex), 3 * (limit - begin));
        begin = limit;
    }
    if (found)
        atomic_store_explicit(&search->is_suspect, true, memory_order_relaxed);
}

static bool instance_is_active(const unsigned char *record)
{
    float transform[12];
    memcpy(transform, record, sizeof transform);
    return bytes_get64(record + INSTANCE_REFERENCE) != 0 && !any_nan(transform, 12);
}

static bool is_active(const struct canonical_geometry *geometry, uint32_t index)
{
    if (geometry->type == GEOMETRY_INSTANCES)
        return instance_is_active(geometry->instances + (size_t)INSTANCE_SIZE * index);
    if (geometry->type == GEOMETRY_AABBS)
        return !any_nan(geometry->boxes + (size_t)6 * index, 6);
    float corners[3][3];
    canonical_triangle(geometry, index, corners);
    return !any_nan(corners[0], 9);
}

/* Each task writes words of its own, if there are words, and counts. */
static void find_chunk(void *context, size_t index)
{
    struct search *search = context;
    const struct canonical *canonical = search->canonical;
    size_t id, end;
    uint32_t inactive = 0;
    parallel_chunk(index, CHUNK, canonical->primitive_count, &id, &end);
    const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, (uint32_t)id)];
    if (search->words)
        memset(search->words + id / 64, 0, activity_words((uint32_t)(end - id)) * sizeof *search->words);
    for (; id < end; id++) {
        while (id - geometry->first_primitive >= geometry->primitive_count)
            geometry++;
        uint64_t active = is_active(geometry, (uint32_t)(id - geometry->first_primitive));
        inactive += !active;
        if (search->words)
            search->words[id / 64] |= active << id % 64;
    }
    atomic_fetch_add_explicit(&search->inactive, inactive, memory_order_relaxed);
}

static bool has_suspect_vertices(struct search *search, const struct build_context *context)
{
    size_t chunks = parallel_chunks(CHUNK, search->canonical->vertex_count);
    parallel_for_until(context->parallel, context->cancel, chunks, scan_vertices, search);
    return atomic_load_explicit(&search->is_suspect, memory_order_relaxed);
}

static enum bvhd_status run(struct search *search, const struct build_context *context, uint32_t *ret_inactive)
{
    size_t chunks = parallel_chunks(CHUNK, search->canonical->primitive_count);
    if (!parallel_for_until(context->parallel, context->cancel, chunks, find_chunk, search))
        return BVHD_CANCELLED;
    *ret_inactive = atomic_load_explicit(&search->inactive, memory_order_relaxed);
    return BVHD_OK;
}

enum bvhd_status activity_count(const struct canonical *canonical, const struct build_context *context,
                                uint32_t *ret_inactive)
{
    struct search search = {.canonical = canonical};
    bool triangles = canonical->geometry_count > 0 && canonical->geometries[0].type == GEOMETRY_TRIANGLES;
    if (!triangles || has_suspect_vertices(&search, context))
        return run(&search, context, ret_inactive);
    if (context_cancelled(context))
        return BVHD_CANCELLED;
    *ret_inactive = 0;
    return BVHD_OK;
}

enum bvhd_status activity_find(const struct canonical *canonical, const struct build_context *context, uint64_t *words)
{
    struct search search = {.canonical = canonical, .words = words};
    uint32_t inactive;
    return run(&search, context, &inactive);
}
