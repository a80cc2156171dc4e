/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/primitive.h"

#include <stddef.h>

#include "builder/input/classification.h"
#include "builder/input/input_kind.h"
#include "builder/kernel/leaves.h"
#include "builder/kernel/vec4.h"

/* Primitives whose refs stay in the first-level cache. One task handles the chunks of a whole block. */
enum { CHUNK = 1024 };

struct box primitive_box(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t index)
{
    struct classification finding = input_kind_of(geometry->type)->look(canonical, geometry, index);
    return finding.kept ? finding.box : box_empty();
}

void primitive_key_boxes(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t index,
                         struct box ret_boxes[2])
{
    const struct input_kind *kind = input_kind_of(geometry->type);
    if (!kind->look_at_keys)
        ret_boxes[0] = ret_boxes[1] = primitive_box(canonical, geometry, index);
    else if (!kind->look_at_keys(canonical, geometry, index, ret_boxes).kept)
        ret_boxes[0] = ret_boxes[1] = box_empty();
}

static void grow_slowly(const struct primitive_finder *finder, uint32_t index, struct vec4_box *boxes)
{
    struct box own[2];
    primitive_key_boxes(finder->canonical, finder->geometry, index, own);
    for (int key = 0; key < 2; key++) {
        const struct vec4_box box = vec4_box_from(&own[key]);
        vec4_box_grow(&boxes[key], box.min, box.max);
    }
}

static bool is_inside(const struct primitive_finder *finder, uint32_t id)
{
    /* wraps around for primitives below the first one */
    return finder->geometry && id - finder->geometry->first_primitive < finder->geometry->primitive_count;
}

/* Finds the geometry of the first of these primitives, and returns how many from there on are in it. */
static inline uint32_t find(struct primitive_finder *finder, const uint32_t *ids, uint32_t count)
{
    uint32_t same = 1;
    if (!is_inside(finder, ids[0])) {
        finder->geometry = &finder->canonical->geometries[canonical_geometry_of(finder->canonical, ids[0])];
        finder->kind = input_kind_of(finder->geometry->type);
    }
    while (same < count && is_inside(finder, ids[same]))
        same++;
    return same;
}

void primitive_grow_keys(struct primitive_finder *finder, const uint32_t *ids, uint32_t count, struct vec4_box *boxes)
{
    for (uint32_t i = 0, same; i < count; i += same) {
        same = find(finder, ids + i, count - i);
        if (finder->kind->grow_keys)
            finder->kind->grow_keys(finder->geometry, ids + i, same, boxes);
        for (uint32_t k = i; !finder->kind->grow_keys && k < i + same; k++)
            grow_slowly(finder, ids[k] - finder->geometry->first_primitive, boxes);
    }
}

void primitive_prefetch_keys(struct primitive_finder *finder, const uint32_t *ids, uint32_t count, int step)
{
    for (uint32_t i = 0; i < count; i++) {
        find(finder, ids + i, 1);
        if (finder->kind->prefetch_keys)
            finder->kind->prefetch_keys(finder->geometry, ids[i], step);
    }
}

/* The totals of one block. */
struct block_totals {
    uint32_t count, primitives;
    struct box bounds, centroids;
    struct classification_counts counts;
};

struct collection {
    const struct canonical *canonical;
    struct primitive_ref *refs;
    struct block_totals *blocks;
    size_t block_count, block_size;
    const struct leaves_options *runs; /* NULL: each ref stands for one primitive */
};

/*
 * Joins neighbours in the request that would share a leaf into one ref. The numbers of a run's primitives are
 * consecutive, so the caller makes sure that none of them was left out.
 */
static uint32_t make_runs(struct primitive_ref *refs, uint32_t count, const struct leaves_options *options)
{
    uint8_t lengths[CHUNK];
    uint32_t runs = leaves_cut(refs, count, options, lengths);
    const struct primitive_ref *next = refs;
    for (uint32_t run = 0; run < runs; run++) {
        uint32_t id = next->id, length = lengths[run];
        vec4_box_store(&refs[run], leaves_box(next, length));
        refs[run].link = length - 1;
        refs[run].id = id;
        next += length;
    }
    return runs;
}

uint32_t primitive_block(uint32_t primitives)
{
    enum { LARGEST = 8192, ENOUGH = 64 };
    uint32_t block = LARGEST;
    while (block > CHUNK && primitives / block < ENOUGH)
        block /= 2;
    return block;
}

/* Adds the refs of primitives [id, end) to a block. */
static void collect_chunk(const struct collection *collection, size_t id, size_t end, struct primitive_ref *refs,
                          struct block_totals *block)
{
    const struct canonical *canonical = collection->canonical;
    const uint32_t asked = (uint32_t)(end - id);
    uint32_t count = 0;
    struct box bounds, centroids;
    while (id < end) {
        const struct canonical_geometry *geometry =
            &canonical->geometries[canonical_geometry_of(canonical, (uint32_t)id)];
        size_t last = (size_t)geometry->first_primitive + geometry->primitive_count;
        last = last < end ? last : end;
        const struct input_kind *kind = input_kind_of(geometry->type);
        count += kind->collect(canonical, geometry, (uint32_t)(id - geometry->first_primitive),
                               (uint32_t)(last - geometry->first_primitive), &block->counts, &refs[count]);
        id = last;
    }
    block->primitives += count;
    if (collection->runs && collection->runs->leaf_max > 1 && count == asked)
        count = make_runs(refs, count, collection->runs);
    primitive_ref_bounds(refs, count, &bounds, &centroids);
    box_grow(&block->bounds, &bounds);
    box_grow(&block->centroids, &centroids);
    block->count += count;
}

static void collect_block(void *context, size_t index)
{
    const struct collection *collection = context;
    struct block_totals block = {.bounds = box_empty(), .centroids = box_empty()};
    size_t begin, end;
    parallel_chunk(index, collection->block_size, collection->canonical->primitive_count, &begin, &end);
    struct primitive_ref *refs = collection->refs + begin;
    for (size_t id = begin; id < end; id += CHUNK)
        collect_chunk(collection, id, end - id < CHUNK ? end : id + CHUNK, refs + block.count, &block);
    collection->blocks[index] = block;
}

/* Adds up the blocks in their order. */
static void combine(const struct collection *collection, struct primitive_refs *refs)
{
    refs->block_count = (uint32_t)collection->block_count;
    for (size_t i = 0; i < collection->block_count; i++) {
        const struct block_totals *block = &collection->blocks[i];
        refs->blocks[i] = block->count;
        refs->count += block->count;
        refs->primitives += block->primitives;
        refs->inactive += block->counts.inactive;
        refs->degenerate += block->counts.degenerate;
        refs->skipped += block->counts.skipped;
        box_grow(&refs->bounds, &block->bounds);
        box_grow(&refs->centroids, &block->centroids);
    }
}

static enum bvhd_status collect(struct collection *collection, const struct build_context *context,
                                struct primitive_refs *refs)
{
    collection->refs = refs->refs =
        memory_array(context->memory, collection->canonical->primitive_count, sizeof *refs->refs);
    collection->blocks = memory_array(context->memory, collection->block_count, sizeof *collection->blocks);
    refs->blocks = memory_array(context->memory, collection->block_count, sizeof *refs->blocks);
    if (!collection->refs || !collection->blocks || !refs->blocks)
        return BVHD_NO_MEMORY;
    if (!parallel_for_until(context->parallel, context->cancel, collection->block_count, collect_block, collection))
        return BVHD_CANCELLED;
    combine(collection, refs);
    return BVHD_OK;
}

bool primitive_close_gaps(struct primitive_refs *refs, const struct build_context *context)
{
    for (uint32_t done = 0, i = 0; refs->blocks && done < refs->count; done += refs->blocks[i++]) {
        const struct primitive_ref *block = refs->refs + (uint64_t)i * refs->block_size;
        if (block != refs->refs + done)
            memmove(refs->refs + done, block, refs->blocks[i] * sizeof *block);
        if (parallel_cancelled(context->cancel))
            return false;
    }
    memory_free(context->memory, refs->blocks);
    refs->blocks = NULL;
    return true;
}

static void free_refs(struct primitive_refs *refs, struct memory *memory)
{
    memory_free(memory, refs->refs);
    memory_free(memory, refs->blocks);
    refs->refs = NULL;
    refs->blocks = NULL;
}

enum bvhd_status primitive_collect_blocks(const struct canonical *canonical, const struct leaves_options *runs,
                                          const struct build_context *context, struct primitive_refs *ret_refs,
                                          struct bvhd_error *error)
{
    struct collection collection = {.canonical = canonical, .runs = runs};
    struct primitive_refs refs = {.bounds = box_empty(), .centroids = box_empty()};
    enum bvhd_status status = BVHD_OK;
    collection.block_size = refs.block_size = primitive_block(canonical->primitive_count);
    collection.block_count = parallel_chunks(collection.block_size, canonical->primitive_count);
    if (collection.block_count > 0)
        status = collect(&collection, context, &refs);
    memory_free(context->memory, collection.blocks);
    if (status != BVHD_OK || refs.count == 0)
        free_refs(&refs, context->memory);
    if (status == BVHD_CANCELLED)
        return bvhd_error_set(error, status, "", "cancelled");
    if (status != BVHD_OK)
        return bvhd_error_set(error, status, "", "no memory for the boxes of %u primitives",
                              canonical->primitive_count);
    *ret_refs = refs;
    return BVHD_OK;
}
