/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/activity.h"

#include "builder/update/update_kind.h"
#include "proto/base/prefix.h"

/* Vertices or primitives in a task: a multiple of 64. */
enum { CHUNK = 8192 };

struct search {
    const struct canonical *canonical;
    uint64_t *words;
    atomic_bool is_suspect; /* a vertex is NaN */
    _Atomic uint32_t inactive;
};

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
            found |= update_kind_of(geometry->type)->has_nan(geometry, begin - geometry->first_vertex, limit - begin);
        begin = limit;
    }
    if (found)
        atomic_store_explicit(&search->is_suspect, true, memory_order_relaxed);
}

/* Returns how many primitives from `first` on belong to one geometry, one word and one chunk. */
static uint32_t run_length(const struct canonical_geometry *geometry, uint32_t first, size_t id, size_t end)
{
    size_t count = 64 - id % 64;
    count = count < end - id ? count : end - id;
    return count < geometry->primitive_count - first ? (uint32_t)count : geometry->primitive_count - first;
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
    for (uint32_t count; id < end; id += count) {
        while (id - geometry->first_primitive >= geometry->primitive_count)
            geometry++;
        const uint32_t first = (uint32_t)(id - geometry->first_primitive);
        count = run_length(geometry, first, id, end);
        const uint64_t active = update_kind_of(geometry->type)->active(geometry, first, count);
        inactive += count - (uint32_t)__builtin_popcountll(active);
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
    const struct canonical_geometry *first = canonical->geometry_count > 0 ? canonical->geometries : NULL;
    if (!first || !update_kind_of(first->type)->has_nan || has_suspect_vertices(&search, context))
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
