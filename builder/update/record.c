/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/record_internal.h"

#include "builder/format/layout.h"
#include "builder/input/canonical_form.h"
#include "builder/update/activity.h"
#include "builder/update/update_kind.h"
#include "proto/base/checksum.h"
#include "proto/base/kind.h"

/* Primitives in a task that sums indices. */
enum { SUM_CHUNK = 16384 };

uint64_t record_size(uint32_t geometries, uint32_t primitives, uint32_t inactive, bool has_micromaps)
{
    const uint64_t row = sizeof(struct record_geometry) + (has_micromaps ? sizeof(struct record_micromap) : 0);
    return sizeof(struct record_header) + geometries * row + (inactive > 0 ? 8 * activity_words(primitives) : 0);
}

void record_view(const struct record_header *header, struct record *ret_record)
{
    const struct record_geometry *geometries = (const void *)(header + 1);
    const struct record_micromap *micromaps = (const void *)(geometries + header->geometry_count);
    const bool has_micromaps = header->version == RECORD_MICROMAPS;
    const void *end = has_micromaps ? (const void *)(micromaps + header->geometry_count) : micromaps;
    *ret_record = (struct record){
        .bytes = {(const unsigned char *)header, header->size},
        .header = header,
        .geometries = geometries,
        .micromaps = has_micromaps ? micromaps : NULL,
        .active = header->inactive_count > 0 ? end : NULL,
    };
}

uint32_t record_type_of(const struct record *record)
{
    const uint32_t count = record->header->geometry_count;
    for (uint32_t g = 0; g < count; g++)
        if (kind_find(record->geometries[g].type)->moves)
            return record->geometries[g].type;
    if (count > 0)
        return record->geometries[0].type;
    return record->header->type == STRUCTURE_TOP ? GEOMETRY_INSTANCES : GEOMETRY_TRIANGLES;
}

/* The rows of the canonical form have what the request said; those of other structures than updatable ones say less. */
static struct record_geometry make_row(const struct form_geometry *row)
{
    const struct update_kind *kind = update_kind_of(row->type);
    struct record_geometry made = {
        .type = row->type,
        .flags = row->flags,
        .primitive_count = row->primitive_count,
        .vertex_count = row->vertex_count,
        .indexed = row->indexed,
        .vertex_format = row->vertex_format,
        .index_type = row->index_type,
        .lowest_index = row->lowest_index,
    };
    if (kind->describe)
        kind->describe(row, &made);
    return made;
}

/* Returns whether updates must name the same triangles of the same micromaps. */
static bool keeps_micromaps(const struct canonical *canonical)
{
    return !(canonical->flags & (BUILD_ALLOW_MICROMAP_UPDATE | BUILD_ALLOW_MICROMAP_DATA_UPDATE));
}

static void fill_header(const struct canonical *canonical, const struct build_options *options, uint32_t inactive,
                        struct record_header *header)
{
    const struct layout *layout = layout_find(options->target);
    const bool has_micromaps = canonical_has_micromaps(canonical);
    *header = (struct record_header){
        .version = has_micromaps ? RECORD_MICROMAPS : update_kind_of(canonical_kind(canonical))->version,
        .size = record_size(canonical->geometry_count, canonical->primitive_count, inactive, has_micromaps),
        .type = canonical->type,
        .flags = canonical->flags,
        .geometry_count = canonical->geometry_count,
        .primitive_count = canonical->primitive_count,
        .inactive_count = inactive,
        .target = options->target,
        .layout_flags = options->layout_flags,
    };
    memcpy(header->magic, record_magic, sizeof header->magic);
    if (layout && layout->variants > 0)
        header->device = options->device;
}

/* Makes the row of a geometry's micromap; the checksum of its indices is added later, if updates must keep them. */
static struct record_micromap make_micromap(const struct canonical *canonical, uint32_t g)
{
    const struct canonical_geometry *geometry = &canonical->geometries[g];
    struct record_micromap made = {.attachment = RECORD_NO_MICROMAP};
    if (!geometry->has_micromaps)
        return made;
    const struct form_micromap *form = (const void *)(canonical->bytes + form_row(canonical, g)->micromap_offset);
    made.attachment = geometry->micromap > 0 ? RECORD_MICROMAP : RECORD_SPECIAL_ONLY;
    made.index_sum = form->shape_sum;
    if (geometry->micromap > 0 && keeps_micromaps(canonical))
        made.key = canonical->references[geometry->micromap - 1].key;
    return made;
}

struct sums {
    const struct canonical *canonical;
    struct record_geometry *rows;
    struct record_micromap *micromaps; /* NULL: there are none, or they may change */
};

/*
 * Adds the checksums of a chunk of primitives to those of their geometries. The sum of a geometry does not depend on
 * the order of its parts, and each part's checksum begins with its place.
 */
static void sum_chunk(void *context, size_t index)
{
    const struct sums *sums = context;
    const struct canonical *canonical = sums->canonical;
    size_t begin, end;
    parallel_chunk(index, SUM_CHUNK, canonical->primitive_count, &begin, &end);
    for (uint32_t g = canonical_geometry_of(canonical, (uint32_t)begin); begin < end; g++) {
        const struct canonical_geometry *geometry = &canonical->geometries[g];
        size_t first = begin - geometry->first_primitive, last = (size_t)end - geometry->first_primitive;
        last = last < geometry->primitive_count ? last : geometry->primitive_count;
        begin += last - first;
        if (sums->micromaps && geometry->micromap_indices && first < last) {
            const uint32_t *indices = geometry->micromap_indices + first;
            const struct bytes part = {(const unsigned char *)indices, sizeof *indices * (last - first)};
            __atomic_fetch_add(&sums->micromaps[g].index_sum, checksum(part, first), __ATOMIC_RELAXED);
        }
        if (!geometry->indices || first == last)
            continue;
        const size_t size = kind_find(geometry->type)->primitive_bytes;
        const struct bytes part = {(const unsigned char *)geometry->indices + size * first, size * (last - first)};
        __atomic_fetch_add(&sums->rows[g].index_sum, checksum(part, first), __ATOMIC_RELAXED);
    }
}

static enum bvhd_status fill(const struct canonical *canonical, const struct build_context *context,
                             struct record_header *header)
{
    struct record_geometry *rows = (void *)(header + 1);
    struct record_micromap *micromaps = (void *)(rows + canonical->geometry_count);
    const struct form_geometry *form_rows = (const void *)(canonical->bytes + sizeof(struct form_header));
    for (uint32_t g = 0; g < canonical->geometry_count; g++) {
        if (parallel_cancelled_at(context->cancel, g))
            return BVHD_CANCELLED;
        rows[g] = make_row(&form_rows[g]);
        if (header->version == RECORD_MICROMAPS)
            micromaps[g] = make_micromap(canonical, g);
    }
    const bool sums_micromaps = header->version == RECORD_MICROMAPS && keeps_micromaps(canonical);
    struct sums sums = {canonical, rows, sums_micromaps ? micromaps : NULL};
    size_t chunks = canonical->vertex_count > 0 ? parallel_chunks(SUM_CHUNK, canonical->primitive_count) : 0;
    if (!parallel_for_until(context->parallel, context->cancel, chunks, sum_chunk, &sums))
        return BVHD_CANCELLED;
    if (header->inactive_count == 0)
        return BVHD_OK;
    struct record made;
    record_view(header, &made);
    return activity_find(canonical, context, (uint64_t *)(uintptr_t)made.active);
}

enum bvhd_status record_make(const struct canonical *canonical, const struct build_options *options,
                             const struct build_context *context, struct record *ret_record, struct bvhd_error *error)
{
    uint32_t inactive;
    if (activity_count(canonical, context, &inactive) != BVHD_OK)
        return bvhd_error_set(error, BVHD_CANCELLED, "record", "cancelled");
    uint64_t size = record_size(canonical->geometry_count, canonical->primitive_count, inactive,
                                canonical_has_micromaps(canonical));
    struct record_header *header = memory_alloc(context->memory, size);
    if (!header)
        return bvhd_error_no_memory(error, "record", "no memory for %llu bytes", (unsigned long long)size);
    fill_header(canonical, options, inactive, header);
    if (fill(canonical, context, header) != BVHD_OK) {
        memory_free(context->memory, header);
        return bvhd_error_set(error, BVHD_CANCELLED, "record", "cancelled");
    }
    record_view(header, ret_record);
    ret_record->owned = header;
    return BVHD_OK;
}

void record_finish(struct record *record, struct memory *memory)
{
    if (!record)
        return;
    memory_free(memory, record->owned);
    *record = (struct record){0};
}
