/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/sample_cut.h"

#include "builder/kernel/bins.h"

enum { LARGE = 2048, CHUNK_LEAST = 512, CHUNKS_MOST = 16 };

/* The result of one task about its refs. */
struct chunk {
    struct vec4_box centroids;
    struct bins bins;
    uint32_t left; /* how many are on the left */
    uint32_t to_left, to_right; /* where the first one of each side goes */
};

/* A large part that is cut on all threads. */
struct cut {
    const struct primitive_ref *refs;
    uint32_t count, chunk_size, chunk_count;
    const struct parallel *parallel;
    struct bins_mapping mapping;
    struct sample_plane plane;
    struct primitive_ref *to;
    struct chunk chunks[CHUNKS_MOST];
};

bool sample_is_large(uint32_t count, const struct parallel *parallel)
{
    return count >= LARGE && parallel->threads > 1;
}

static void cut_init(struct cut *cut, const struct primitive_ref *refs, uint32_t count, const struct parallel *parallel)
{
    uint32_t size = count / CHUNKS_MOST + 1;
    cut->refs = refs;
    cut->count = count;
    cut->chunk_size = size > CHUNK_LEAST ? size : CHUNK_LEAST;
    cut->chunk_count = (uint32_t)parallel_chunks(cut->chunk_size, count);
    cut->parallel = parallel;
}

/* Returns the refs of a chunk. */
static const struct primitive_ref *chunk_refs(const struct cut *cut, size_t index, uint32_t *ret_count)
{
    size_t begin, end;
    parallel_chunk(index, cut->chunk_size, cut->count, &begin, &end);
    *ret_count = (uint32_t)(end - begin);
    return cut->refs + begin;
}

static void bound_chunk(void *context, size_t index)
{
    struct cut *cut = context;
    uint32_t count;
    const struct primitive_ref *refs = chunk_refs(cut, index, &count);
    cut->chunks[index].centroids = bins_centroids(refs, count);
}

static void add_chunk(void *context, size_t index)
{
    struct cut *cut = context;
    struct bins *bins = &cut->chunks[index].bins;
    uint32_t count;
    const struct primitive_ref *refs = chunk_refs(cut, index, &count);
    bins_clear(bins, &cut->mapping);
    bins_add(bins, &cut->mapping, refs, count);
}

/* Finds the plane on all threads, as bins_centroids and bins_find do on one. */
static bool find_together(const struct primitive_ref *refs, uint32_t count, const struct parallel *parallel,
                          struct bins_mapping *ret_mapping, struct bins_plane *ret_plane)
{
    struct cut cut;
    struct chunk *chunks = cut.chunks;
    cut_init(&cut, refs, count, parallel);
    parallel_for(parallel, cut.chunk_count, bound_chunk, &cut);
    for (uint32_t i = 1; i < cut.chunk_count; i++)
        vec4_box_grow(&chunks[0].centroids, chunks[i].centroids.min, chunks[i].centroids.max);
    bins_map(&chunks[0].centroids, count, &cut.mapping);
    parallel_for(parallel, cut.chunk_count, add_chunk, &cut);
    for (uint32_t i = 1; i < cut.chunk_count; i++)
        bins_merge(&chunks[0].bins, &cut.mapping, &chunks[i].bins);
    *ret_mapping = cut.mapping;
    return bins_choose(&chunks[0].bins, &cut.mapping, count, ret_plane);
}

bool sample_plane_find(const struct primitive_ref *refs, uint32_t count, const struct parallel *parallel,
                       struct sample_plane *ret_plane)
{
    struct bins_mapping mapping;
    struct bins_plane plane;
    bool found;
    if (sample_is_large(count, parallel)) {
        found = find_together(refs, count, parallel, &mapping, &plane);
    } else {
        const struct vec4_box centroids = bins_centroids(refs, count);
        found = bins_find(refs, count, &centroids, &mapping, &plane);
    }
    if (found)
        *ret_plane = (struct sample_plane){
            .threshold = mapping.base[plane.axis] + (float)plane.bin / mapping.scale[plane.axis], .axis = plane.axis};
    return found;
}

static inline bool is_left(const struct vec4_box *ref, const struct sample_plane *plane)
{
    const vec4 centroid = ref->min + ref->max;
    return centroid[plane->axis] < plane->threshold;
}

uint32_t sample_divide(struct primitive_ref *refs, uint32_t count, const struct sample_plane *plane)
{
    uint32_t left = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct vec4_box ref = vec4_box_load(&refs[i]);
        vec4_box_store(&refs[i], vec4_box_load(&refs[left]));
        vec4_box_store(&refs[left], ref);
        left += is_left(&ref, plane);
    }
    return left;
}

static void count_chunk(void *context, size_t index)
{
    struct cut *cut = context;
    uint32_t count, left = 0;
    const struct primitive_ref *refs = chunk_refs(cut, index, &count);
    for (uint32_t i = 0; i < count; i++) {
        const struct vec4_box ref = vec4_box_load(&refs[i]);
        left += is_left(&ref, &cut->plane);
    }
    cut->chunks[index].left = left;
}

static void move_chunk(void *context, size_t index)
{
    struct cut *cut = context;
    /* chosen by an index and not by a branch, which could not be predicted */
    struct primitive_ref *to[2] = {cut->to + cut->chunks[index].to_right, cut->to + cut->chunks[index].to_left};
    uint32_t count;
    const struct primitive_ref *refs = chunk_refs(cut, index, &count);
    for (uint32_t i = 0; i < count; i++) {
        const struct vec4_box ref = vec4_box_load(&refs[i]);
        vec4_box_store(to[is_left(&ref, &cut->plane)]++, ref);
    }
}

uint32_t sample_divide_into(const struct primitive_ref *refs, uint32_t count, const struct sample_plane *plane,
                            const struct parallel *parallel, struct primitive_ref *ret_refs)
{
    struct cut cut;
    uint32_t left = 0, right = 0;
    cut_init(&cut, refs, count, parallel);
    cut.plane = *plane;
    cut.to = ret_refs;
    parallel_for(parallel, cut.chunk_count, count_chunk, &cut);
    for (uint32_t i = 0; i < cut.chunk_count; i++)
        left += cut.chunks[i].left;
    for (uint32_t i = 0, at = 0; i < cut.chunk_count; i++) {
        uint32_t size;
        chunk_refs(&cut, i, &size);
        cut.chunks[i].to_left = at;
        cut.chunks[i].to_right = left + right;
        at += cut.chunks[i].left;
        right += size - cut.chunks[i].left;
    }
    parallel_for(parallel, cut.chunk_count, move_chunk, &cut);
    return left;
}
