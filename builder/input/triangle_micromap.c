/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/triangle_micromap.h"

#include <inttypes.h>

#include "builder/format/portable_micromap.h"
#include "builder/input/fetch_internal.h"
#include "builder/input/micromap_usages.h"
#include "builder/input/validate.h"
#include "proto/base/checksum.h"
#include "proto/base/place.h"

enum { CHUNK = 8192, MIXED = MICRO_STATES };

static const struct triangle_micromap *micromap_of(const struct geometry *geometry)
{
    const bool has = form_may_have_micromap(geometry->type) && geometry->triangles.micromap.is_given;
    return has ? &geometry->triangles.micromap : NULL;
}

bool triangle_micromap_names_any(const struct build_input *input)
{
    for (uint32_t i = 0; i < input->geometry_count; i++) {
        const struct triangle_micromap *micromap = micromap_of(&input->geometries[i]);
        if (micromap && micromap->micromap != 0)
            return true;
    }
    return false;
}

static uint32_t size_of(uint32_t index_type)
{
    return index_type == INDEX_UINT8 ? 1 : index_type == INDEX_UINT16 ? 2 : 4;
}

enum bvhd_status triangle_micromap_check_memory(const struct validate_subject *subject)
{
    const struct triangle_micromap *micromap = micromap_of(subject->geometry);
    const uint32_t count = subject->geometry->range.primitive_count;
    if (!micromap)
        return BVHD_OK;
    const bool is_ext = micromap->has_usages;
    const char *const where = "triangles.micromap.indexBuffer";
    if (micromap->index_type != INDEX_NONE) {
        const uint32_t size = size_of(micromap->index_type);
        if (count == 0 ||
            (micromap->indices.data && bytes_reach(micromap->indices.size, 0, micromap->stride, count - 1, size)))
            return BVHD_OK;
        return validate_refuse_memory(subject, is_ext ? BVHD_VUID_11821 : BVHD_VUID_11572, where, &micromap->indices,
                                      "indices");
    }
    if (micromap->indices.data)
        return bvhd_error_rule(subject->error, is_ext ? BVHD_VUID_10892 : BVHD_VUID_11571,
                               VALIDATE_GEOMETRY_PLACE(subject, where),
                               "indexBuffer is not NULL, but indexType is NONE");
    if (micromap->micromap == 0)
        return bvhd_error_rule(subject->error, is_ext ? BVHD_VUID_NONE : BVHD_VUID_11579,
                               VALIDATE_GEOMETRY_PLACE(subject, "triangles.micromap.micromap"),
                               "micromap is NULL, but indexType is NONE");
    return BVHD_OK;
}

/* ---- The micromaps that are named ---- */

/* A micromap of the caller's table. */
struct named {
    uint32_t row; /* 1-based; 0: no triangles have named it yet */
    struct portable_micromap_view view;
    unsigned char *wholes; /* of each triangle the state of all its micro-triangles, or MIXED; NULL: not normalised */
};

struct reading {
    struct fetch *fetch;
    const struct build_context *context;
    struct bvhd_error *error;
    struct named *named; /* by position in the caller's table */
    struct reference_rows *rows;
};

/* Returns the state of all micro-triangles of a triangle, or MIXED. */
static unsigned char whole_of(const struct portable_micromap_view *view, uint32_t triangle)
{
    const struct micromap_triangle *found = &view->triangles[triangle];
    const enum micro_format format = (enum micro_format)found->format;
    const unsigned char *states = view->states + found->offset;
    const enum micro_state first = micro_triangle_state(states, format, 0);
    const uint32_t count = micro_triangle_count(found->level), bytes = micro_triangle_bytes(format, found->level);
    if (count * found->format < 8) {
        for (uint32_t i = 1; i < count; i++)
            if (micro_triangle_state(states, format, i) != first)
                return MIXED;
        return (unsigned char)first;
    }
    const unsigned char all = (unsigned char)(first * (format == MICRO_2_STATE ? 0xff : 0x55));
    return states[0] == all && memcmp(states, states + 1, bytes - 1) == 0 ? (unsigned char)first : MIXED;
}

static void find_wholes(void *context, size_t chunk)
{
    const struct named *named = context;
    size_t begin, end;
    parallel_chunk(chunk, CHUNK, named->view.header->triangle_count, &begin, &end);
    for (size_t i = begin; i < end; i++)
        named->wholes[i] = whole_of(&named->view, (uint32_t)i);
}

static enum bvhd_status cancelled(const struct reading *reading)
{
    return bvhd_error_set(reading->error, BVHD_CANCELLED, place("infos[%u]", reading->fetch->index).text, "cancelled");
}

/* Updates that may replace the micromap or its states need the names of its triangles. */
static bool normalises(const struct build_input *input)
{
    return !(input->flags & (BUILD_ALLOW_MICROMAP_UPDATE | BUILD_ALLOW_MICROMAP_DATA_UPDATE));
}

/* Opens a micromap that is named for the first time, and makes its row. */
static enum bvhd_status open_named(struct reading *reading, const struct reference *reference, struct named *named)
{
    const struct build_context *context = reading->context;
    enum bvhd_status status = portable_micromap_open(reference->blob, &named->view, reading->error);
    if (status != BVHD_OK)
        return status;
    const uint32_t count = named->view.header->triangle_count;
    reading->rows->rows[reading->rows->count] = form_micromap_reference(&reference->key, count);
    named->row = ++reading->rows->count;
    if (!normalises(reading->fetch->input) || count == 0)
        return BVHD_OK;
    named->wholes = memory_alloc(context->memory, count);
    if (!named->wholes)
        return bvhd_error_no_memory(reading->error, place("infos[%u].references", reading->fetch->index).text,
                                    "no memory for the states of %u triangles", count);
    return parallel_for_until(context->parallel, context->cancel, parallel_chunks(CHUNK, count), find_wholes, named)
               ? BVHD_OK
               : cancelled(reading);
}

/* Finds the micromap of a geometry; *ret_named is NULL if it names none. */
static enum bvhd_status find_named(struct reading *reading, uint32_t index, struct named **ret_named)
{
    const struct build_input *input = reading->fetch->input;
    const struct triangle_micromap *micromap = &input->geometries[index].triangles.micromap;
    *ret_named = NULL;
    if (micromap->micromap == 0)
        return BVHD_OK;
    const uint64_t at = reference_lookup_find(&reading->fetch->lookup, micromap->micromap);
    if (at == 0)
        return bvhd_error_rule(
            reading->error,
            micromap->has_usages ? BVHD_VUID_OpacityMicromapEXT_micromap_parameter
                                 : BVHD_VUID_OpacityMicromapKHR_micromap_parameter,
            place("infos[%u].geometries[%u].triangles.micromap.micromap", reading->fetch->index, index).text,
            "names no known micromap");
    *ret_named = &reading->named[at - 1];
    return (*ret_named)->row ? BVHD_OK : open_named(reading, &input->references[at - 1], *ret_named);
}

/* ---- Indices ---- */

/* The indices of one geometry. */
struct indexing {
    const struct triangle_micromap *micromap;
    const struct named *named; /* NULL: there are special indices only */
    uint32_t count;
    uint32_t *indices; /* in the block */
    _Atomic uint32_t first_wrong; /* the first triangle whose index names nothing, or UINT32_MAX */
    _Atomic uint64_t found[MICROMAP_FORMATS][MICRO_LEVEL_MAX + 1];
    uint64_t shape_sum;
};

/* Reads an index, once. Special ones become those of 32 bits. */
static uint32_t read_index(const struct triangle_micromap *micromap, uint32_t triangle)
{
    enum { SPECIAL = 4 };
    if (micromap->index_type == INDEX_NONE)
        return triangle;
    const unsigned char *at = micromap->indices.data + micromap->stride * triangle;
    if (micromap->index_type == INDEX_UINT32)
        return bytes_get32(at);
    const bool is_byte = micromap->index_type == INDEX_UINT8;
    const uint32_t index = is_byte ? *at : bytes_get16(at);
    const uint32_t most = is_byte ? UINT8_MAX : UINT16_MAX;
    return index > most - SPECIAL ? index | ~most : index;
}

/* Returns the final index of a triangle, and counts the micromap's triangle that it names. */
static uint32_t take_index(struct indexing *indexing, uint32_t triangle, struct micromap_usages *usages)
{
    const struct named *named = indexing->named;
    const uint32_t index = read_index(indexing->micromap, triangle);
    fetch_settle();
    if (index >= MICROMAP_FULLY_UNKNOWN_OPAQUE)
        return index;
    const uint32_t name = index + indexing->micromap->base_triangle;
    if (!named || name >= named->view.header->triangle_count) {
        fetch_lower(&indexing->first_wrong, triangle);
        return 0;
    }
    const struct micromap_triangle *found = &named->view.triangles[name];
    usages->counts[found->format - 1][found->level]++;
    return named->wholes && named->wholes[name] != MIXED ? ~(uint32_t)named->wholes[name] : name;
}

/* Adds the shapes of some triangles, which have been read, to the checksum. */
static void add_shapes(struct indexing *indexing, size_t begin, size_t end)
{
    unsigned char shapes[CHUNK];
    for (size_t i = begin; i < end; i++) {
        const uint32_t index = indexing->indices[i];
        const bool is_special = index >= MICROMAP_FULLY_UNKNOWN_OPAQUE;
        const struct micromap_triangle *found = is_special ? NULL : &indexing->named->view.triangles[index];
        shapes[i - begin] = (unsigned char)(is_special ? 0 : found->level << 2 | found->format);
    }
    indexing->shape_sum += checksum((struct bytes){shapes, end - begin}, begin);
}

static void take_indices(void *context, size_t chunk)
{
    struct indexing *indexing = context;
    struct micromap_usages usages = {{{0}}};
    size_t begin, end;
    parallel_chunk(chunk, CHUNK, indexing->count, &begin, &end);
    for (size_t i = begin; i < end; i++)
        indexing->indices[i] = take_index(indexing, (uint32_t)i, &usages);
    for (int format = 0; format < MICROMAP_FORMATS; format++)
        for (int level = 0; level <= MICRO_LEVEL_MAX; level++)
            if (usages.counts[format][level] > 0)
                atomic_fetch_add_explicit(&indexing->found[format][level], usages.counts[format][level],
                                          memory_order_relaxed);
}

/* The description does not change, but its memory may: only the number of the triangle is reported. */
static enum bvhd_status report_wrong(const struct reading *reading, uint32_t index, const struct indexing *indexing)
{
    const struct triangle_micromap *micromap = indexing->micromap;
    const bool has_rule = micromap->index_type == INDEX_NONE && !micromap->has_usages;
    const struct place where = place("infos[%u].geometries[%u].triangles.micromap.indices[%u]", reading->fetch->index,
                                     index, indexing->first_wrong);
    if (!indexing->named)
        return bvhd_error_set(reading->error, BVHD_INVALID, where.text, "not a special index, but micromap is NULL");
    return bvhd_error_rule(reading->error, has_rule ? BVHD_VUID_11576 : BVHD_VUID_NONE, where.text,
                           "the micromap has %" PRIu32 " triangles, and none of this index and base %" PRIu32,
                           indexing->named->view.header->triangle_count, micromap->base_triangle);
}

static enum bvhd_status check_usages(const struct reading *reading, uint32_t index, const struct indexing *indexing)
{
    struct micromap_usages said, found;
    const struct place where =
        place("infos[%u].geometries[%u].triangles.micromap.usageCounts", reading->fetch->index, index);
    if (!indexing->micromap->has_usages)
        return BVHD_OK;
    for (int format = 0; format < MICROMAP_FORMATS; format++)
        for (int level = 0; level <= MICRO_LEVEL_MAX; level++)
            found.counts[format][level] = indexing->found[format][level];
    enum bvhd_status status = micromap_usages_read(&indexing->micromap->usages, 0, where, &said, reading->error);
    return status == BVHD_OK ? micromap_usages_compare(&said, &found, where, reading->error) : status;
}

static enum bvhd_status read_geometry(struct reading *reading, uint32_t index)
{
    const struct build_context *context = reading->context;
    const struct geometry *geometry = &reading->fetch->input->geometries[index];
    struct form_micromap *head = (void *)(reading->fetch->block + fetch_row(reading->fetch, index)->micromap_offset);
    struct named *named;
    enum bvhd_status status = find_named(reading, index, &named);
    if (status != BVHD_OK)
        return status;
    *head = (struct form_micromap){.reference = named ? named->row : 0};
    struct indexing indexing = {.micromap = &geometry->triangles.micromap,
                                .named = named,
                                .count = geometry->range.primitive_count,
                                .indices = (uint32_t *)(void *)(head + 1)};
    atomic_init(&indexing.first_wrong, UINT32_MAX);
    if (!parallel_for_until(context->parallel, context->cancel, parallel_chunks(CHUNK, indexing.count), take_indices,
                            &indexing))
        return cancelled(reading);
    if (indexing.first_wrong != UINT32_MAX)
        return report_wrong(reading, index, &indexing);
    if (reading->fetch->input->flags & BUILD_ALLOW_MICROMAP_DATA_UPDATE) {
        for (size_t at = 0; at < indexing.count; at += CHUNK)
            add_shapes(&indexing, at, indexing.count - at < CHUNK ? indexing.count : at + CHUNK);
        head->shape_sum = indexing.shape_sum;
    }
    return check_usages(reading, index, &indexing);
}

static enum bvhd_status read_all(struct reading *reading)
{
    const struct build_input *input = reading->fetch->input;
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; status == BVHD_OK && i < input->geometry_count; i++) {
        if (parallel_cancelled_at(reading->context->cancel, i))
            return cancelled(reading);
        if (micromap_of(&input->geometries[i]))
            status = read_geometry(reading, i);
    }
    return status;
}

/* Allocates the tables, which need one place for each reference. */
static enum bvhd_status read_with_tables(struct reading *reading)
{
    struct memory *memory = reading->context->memory;
    const uint32_t count = reading->fetch->lookup.count;
    if (count > 0) {
        reading->named = memory_array(memory, count, sizeof *reading->named);
        reading->rows->rows = memory_array(memory, count, sizeof *reading->rows->rows);
        if (!reading->named || !reading->rows->rows) {
            memory_free(memory, reading->named);
            return bvhd_error_no_memory(reading->error, place("infos[%u].references", reading->fetch->index).text,
                                        "no memory for %u references", count);
        }
        memset(reading->named, 0, count * sizeof *reading->named);
    }
    enum bvhd_status status = read_all(reading);
    for (uint32_t i = 0; i < count; i++)
        memory_free(memory, reading->named[i].wholes);
    memory_free(memory, reading->named);
    return status;
}

enum bvhd_status triangle_micromaps_read(struct fetch *fetch, const struct build_context *context,
                                         struct reference_rows *ret_rows, struct bvhd_error *error)
{
    struct reference_rows rows = {NULL, 0};
    struct reading reading = {.fetch = fetch, .context = context, .error = error, .rows = &rows};
    enum bvhd_status status = read_with_tables(&reading);
    if (status == BVHD_OK)
        *ret_rows = rows;
    else
        memory_free(context->memory, rows.rows);
    return status;
}

/* ---- Blocks from elsewhere ---- */

enum bvhd_status triangle_micromap_check_foreign(const struct canonical *canonical, uint32_t index,
                                                 struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    if (!geometry->has_micromaps)
        return BVHD_OK;
    const struct form_micromap *head = (const void *)(canonical->bytes + form_row(canonical, index)->micromap_offset);
    if (head->reserved != 0 || (head->shape_sum != 0 && !(canonical->flags & BUILD_ALLOW_MICROMAP_DATA_UPDATE)))
        return form_corrupt_row(error, index, "micromap.reserved", "not 0");
    if (head->reference > canonical->reference_count)
        return form_corrupt_row(error, index, "micromap.reference", "there is no such row");
    const uint32_t most = head->reference ? canonical->references[head->reference - 1].triangle_count : 0;
    for (uint32_t i = 0; i < geometry->primitive_count; i++)
        if (geometry->micromap_indices[i] >= most && geometry->micromap_indices[i] < MICROMAP_FULLY_UNKNOWN_OPAQUE)
            return form_corrupt(error, place("geometries[%u].micromap.indices[%u]", index, i).text,
                                "there is no such triangle");
    return BVHD_OK;
}

enum bvhd_status triangle_micromap_check_references(const struct canonical *canonical, struct bvhd_error *error)
{
    uint32_t used = 0;
    for (uint32_t i = 0; i < canonical->geometry_count; i++) {
        if (canonical->geometries[i].micromap > used + 1)
            return form_corrupt_row(error, i, "micromap.reference", "a reference out of order");
        used = canonical->geometries[i].micromap > used ? canonical->geometries[i].micromap : used;
    }
    return used == canonical->reference_count
               ? BVHD_OK
               : form_corrupt(error, "referenceCount", "references that no geometry names");
}
