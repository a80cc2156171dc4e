/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/wire/rows.h"

#include <inttypes.h>
#include <stdatomic.h>

#include "proto/base/place.h"
#include "proto/wire/row_kind.h"

/* The spans of a row, in the order of enum row_array. */
static const struct {
    const char *name;
    size_t at; /* in the row */
} row_spans[ROW_ARRAYS] = {
    [ROW_DATA] = {"data", offsetof(struct geometry_row, data)},
    [ROW_INDICES] = {"indices", offsetof(struct geometry_row, indices)},
    [ROW_TRANSFORM] = {"transform", offsetof(struct geometry_row, transform)},
    [ROW_RADII] = {"radii", offsetof(struct geometry_row, radii)},
    [ROW_END_POSITIONS] = {"endPositions", offsetof(struct geometry_row, end_positions)},
    [ROW_USAGES] = {"usages", offsetof(struct geometry_row, usages)},
    [ROW_MICROMAP_INDICES] = {"micromapIndices", offsetof(struct geometry_row, micromap_indices)},
    [ROW_MICROMAP_TRIANGLES] = {"micromapTriangles", offsetof(struct geometry_row, micromap_triangles)},
    [ROW_COORDINATES] = {"coordinates", offsetof(struct geometry_row, coordinates)},
};

struct arrays {
    struct bytes of[ROW_ARRAYS]; /* data NULL: not given */
};

static struct arrays arrays_of(const struct geometry *geometry)
{
    const struct row_kind *kind = row_kind_find(geometry->type);
    struct arrays arrays = {{{NULL, 0}}};
    for (int array = 0; array < ROW_ARRAYS; array++)
        if (kind->arrays[array])
            memcpy(&arrays.of[array], (const unsigned char *)geometry + kind->arrays[array], sizeof arrays.of[array]);
    return arrays;
}

/* Places the memory of all geometries in the order of the payload. */
struct payload_layout {
    struct arrays last; /* of the previous geometry */
    struct row_span spans[ROW_ARRAYS]; /* of the geometry that was placed last */
    bool fresh[ROW_ARRAYS]; /* true unless the array shares the span of the previous geometry */
    uint64_t end;
};

/* Moves *end behind `size` more bytes and their padding. */
static bool extend(uint64_t *end, uint64_t size)
{
    uint64_t sum;
    if (!bytes_add(*end, size, &sum) || sum > UINT64_MAX - ROWS_ALIGNMENT)
        return false;
    *end = bytes_align(sum, ROWS_ALIGNMENT);
    return true;
}

static bool place_array(struct payload_layout *layout, int array, struct bytes bytes)
{
    const struct bytes *last = &layout->last.of[array];
    layout->fresh[array] = bytes.data != last->data || bytes.size != last->size;
    if (layout->fresh[array])
        layout->spans[array] = bytes.data ? (struct row_span){layout->end, bytes.size} : (struct row_span){0, 0};
    return !layout->fresh[array] || !bytes.data || extend(&layout->end, bytes.size);
}

static bool place_geometry(struct payload_layout *layout, const struct geometry *geometry)
{
    struct arrays arrays = arrays_of(geometry);
    for (int array = 0; array < ROW_ARRAYS; array++)
        if (!place_array(layout, array, arrays.of[array]))
            return false;
    layout->last = arrays;
    return true;
}

uint32_t rows_geometry_size(const struct build_input *input)
{
    uint32_t size = ROWS_GEOMETRY_LEAST;
    for (uint32_t i = 0; i < input->geometry_count && size < ROWS_GEOMETRY_SIZE; i++) {
        uint32_t needed = row_kind_size(&input->geometries[i]);
        size = needed > size ? needed : size;
    }
    return size;
}

/* Counts are 32-bit numbers, so the sum cannot overflow. */
static uint64_t rows_end(const struct build_input *input)
{
    return (uint64_t)input->geometry_count * rows_geometry_size(input) +
           (uint64_t)input->reference_count * sizeof(struct reference_row);
}

bool rows_payload_size(const struct build_input *input, uint64_t *ret_size)
{
    struct payload_layout layout = {.end = rows_end(input)};
    for (uint32_t i = 0; i < input->geometry_count; i++)
        if (!place_geometry(&layout, &input->geometries[i]))
            return false;
    *ret_size = layout.end;
    return true;
}

static struct geometry_row geometry_to_row(const struct geometry *geometry, const struct row_span spans[ROW_ARRAYS])
{
    const struct row_kind *kind = row_kind_find(geometry->type);
    struct geometry_row row = {
        .type = geometry->type,
        .flags = geometry->flags,
        .primitive_count = geometry->range.primitive_count,
        .primitive_offset = geometry->range.primitive_offset,
        .first_vertex = geometry->range.first_vertex,
        .transform_offset = geometry->range.transform_offset,
    };
    kind->to_row(geometry, &row);
    for (int array = 0; array < ROW_ARRAYS; array++)
        memcpy((unsigned char *)&row + row_spans[array].at, &spans[array], sizeof spans[array]);
    return row;
}

static struct reference_row reference_to_row(const struct reference *reference)
{
    struct reference_row row = {
        .handle = reference->handle, .kind = reference->kind, .has_key = reference->has_key, .moves = reference->moves};
    if (reference->has_key)
        memcpy(row.key, reference->key.bytes, sizeof row.key);
    memcpy(row.bounds, reference->bounds.min, sizeof reference->bounds.min);
    memcpy(row.bounds + 3, reference->bounds.max, sizeof reference->bounds.max);
    memcpy(row.slabs, &reference->slabs, sizeof row.slabs);
    return row;
}

/* Writes the rows alone, which lie at the front of the payload. */
static void write_rows(const struct build_input *input, unsigned char *payload)
{
    struct payload_layout layout = {.end = rows_end(input)};
    size_t geometry_size = rows_geometry_size(input);
    for (uint32_t i = 0; i < input->geometry_count; i++) {
        place_geometry(&layout, &input->geometries[i]);
        struct geometry_row row = geometry_to_row(&input->geometries[i], layout.spans);
        memcpy(payload + i * geometry_size, &row, geometry_size);
    }
    unsigned char *references = payload + input->geometry_count * geometry_size;
    for (uint32_t i = 0; i < input->reference_count; i++) {
        struct reference_row row = reference_to_row(&input->references[i]);
        memcpy(references + i * sizeof row, &row, sizeof row);
    }
}

static enum bvhd_status stream_array(struct bytes array, rows_sink sink, void *context)
{
    static const unsigned char zeros[ROWS_ALIGNMENT];
    enum bvhd_status status = array.size > 0 ? sink(context, array) : BVHD_OK;
    uint64_t padding = bytes_align(array.size, ROWS_ALIGNMENT) - array.size;
    return status == BVHD_OK && padding > 0 ? sink(context, (struct bytes){zeros, padding}) : status;
}

static enum bvhd_status stream_data(const struct build_input *input, rows_sink sink, void *context)
{
    struct payload_layout layout = {.end = rows_end(input)};
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < input->geometry_count; i++) {
        place_geometry(&layout, &input->geometries[i]);
        for (int array = 0; array < ROW_ARRAYS; array++)
            if (status == BVHD_OK && layout.fresh[array] && layout.last.of[array].data)
                status = stream_array(layout.last.of[array], sink, context);
    }
    return status;
}

enum bvhd_status rows_stream(const struct build_input *input, struct memory *memory, rows_sink sink, void *context)
{
    uint64_t size = rows_end(input);
    unsigned char *rows = memory_alloc(memory, size);
    if (!rows && size > 0)
        return BVHD_NO_MEMORY;
    if (rows)
        write_rows(input, rows);
    enum bvhd_status status = rows ? sink(context, (struct bytes){rows, size}) : BVHD_OK;
    memory_free(memory, rows);
    return status == BVHD_OK ? stream_data(input, sink, context) : status;
}

static enum bvhd_status copy_piece(void *context, struct bytes piece)
{
    unsigned char **at = context;
    memcpy(*at, piece.data, piece.size);
    *at += piece.size;
    return BVHD_OK;
}

void rows_write(const struct build_input *input, unsigned char *payload)
{
    unsigned char *at = payload + rows_end(input);
    write_rows(input, payload);
    stream_data(input, copy_piece, &at);
}

/* The state of reading one payload. */
struct rows_reader {
    struct bytes payload;
    uint32_t index; /* of the item, for errors */
    const atomic_bool *cancel;
    struct bvhd_error *error;
};

/* All rows of one kind within a payload. */
struct row_range {
    const char *name; /* "geometries" */
    uint32_t count, size; /* number of rows, bytes of one */
    uint32_t known; /* bytes of a row that this version knows */
    uint32_t least; /* bytes of a row that every version knows */
    uint64_t offset;
};

static enum bvhd_status check_range(const struct rows_reader *reading, const struct row_range *range)
{
    struct place where = place("infos[%u].%s", reading->index, range->name);
    if (range->count == 0)
        return BVHD_OK;
    if (range->size < range->least)
        return bvhd_error_set(reading->error, BVHD_CORRUPT, where.text, "rows of %u bytes", range->size);
    if (range->size > ROWS_MAX_SIZE)
        return bvhd_error_set(reading->error, BVHD_TOO_LARGE, where.text, "rows of %u bytes", range->size);
    if (!bytes_reach(reading->payload.size, range->offset, range->size, range->count - 1, range->size))
        return bvhd_error_set(reading->error, BVHD_CORRUPT, where.text, "%u rows are more than %" PRIu64 " bytes hold",
                              range->count, reading->payload.size);
    return BVHD_OK;
}

/*
 * Copies the fields of row `i` that this version knows. Fields that a shorter row lacks become 0, and the rest of a
 * longer row must be 0. The fence keeps the compiler from reading the row a second time instead of the copy, because
 * another process may have changed it.
 */
static enum bvhd_status copy_row(const struct rows_reader *reading, const struct row_range *range, uint32_t i,
                                 void *ret_row)
{
    const unsigned char *row = reading->payload.data + range->offset + (uint64_t)i * range->size;
    if (i % 8192 == 0 && parallel_cancelled(reading->cancel))
        return bvhd_error_set(reading->error, BVHD_CANCELLED, place("infos[%u]", reading->index).text, "cancelled");
    uint32_t size = range->size < range->known ? range->size : range->known;
    memset((unsigned char *)ret_row + size, 0, range->known - size);
    memcpy(ret_row, row, size);
    atomic_signal_fence(memory_order_seq_cst);
    unsigned char rest = 0;
    for (uint32_t at = range->known; at < range->size; at++)
        rest |= row[at];
    if (rest != 0)
        return bvhd_error_set(reading->error, BVHD_UNSUPPORTED,
                              place("infos[%u].%s[%u]", reading->index, range->name, i).text,
                              "fields of a newer version");
    return BVHD_OK;
}

/* Finds the bytes that a span of a geometry's row names. */
static enum bvhd_status read_span(const struct rows_reader *reading, uint32_t geometry, const struct geometry_row *row,
                                  int array, struct bytes *ret_bytes)
{
    struct row_span span;
    memcpy(&span, (const unsigned char *)row + row_spans[array].at, sizeof span);
    if (span.offset == 0 && span.size == 0) {
        *ret_bytes = (struct bytes){NULL, 0};
        return BVHD_OK;
    }
    if (span.offset == 0 || !bytes_reach(reading->payload.size, span.offset, 0, 0, span.size))
        return bvhd_error_set(
            reading->error, BVHD_CORRUPT,
            place("infos[%u].geometries[%u].%s", reading->index, geometry, row_spans[array].name).text,
            "%" PRIu64 " bytes at %" PRIu64 " are outside of the payload", span.size, span.offset);
    *ret_bytes = (struct bytes){reading->payload.data + span.offset, span.size};
    return BVHD_OK;
}

static enum bvhd_status read_arrays(const struct rows_reader *reading, uint32_t i, const struct geometry_row *row,
                                    const struct row_kind *kind, struct geometry *geometry)
{
    enum bvhd_status status = BVHD_OK;
    for (int array = 0; array < ROW_ARRAYS && status == BVHD_OK; array++) {
        struct bytes bytes = {NULL, 0};
        if (!kind->arrays[array])
            continue;
        status = read_span(reading, i, row, array, &bytes);
        if (status == BVHD_OK)
            memcpy((unsigned char *)geometry + kind->arrays[array], &bytes, sizeof bytes);
    }
    return status;
}

/* Returns whether a field is used that will have a meaning for a later version. */
static bool has_newer_fields(const struct geometry_row *row)
{
    return row->reserved != 0 || row->reserved_round != 0;
}

/* Makes all fields of a micromap 0 in the row of triangles that says that they have none. */
static void forget_micromap(struct geometry_row *row)
{
    memset((unsigned char *)row + ROWS_GEOMETRY_ROUND, 0, ROWS_GEOMETRY_ATTACHED - ROWS_GEOMETRY_ROUND);
}

static enum bvhd_status check_micromap(const struct rows_reader *reading, uint32_t i, const struct geometry_row *row)
{
    if (row->has_micromap <= 1 && row->has_usages <= 1)
        return BVHD_OK;
    return bvhd_error_set(reading->error, BVHD_CORRUPT, place("infos[%u].geometries[%u]", reading->index, i).text,
                          "%s is neither 0 nor 1", row->has_micromap > 1 ? "has_micromap" : "has_usages");
}

/* A row with an unknown type passes; validation refuses it. */
static enum bvhd_status row_to_geometry(const struct rows_reader *reading, uint32_t i, struct geometry_row *row,
                                        struct geometry *ret_geometry)
{
    const struct row_kind *kind = row_kind_find(row->type);
    if (has_newer_fields(row))
        return bvhd_error_set(reading->error, BVHD_UNSUPPORTED,
                              place("infos[%u].geometries[%u]", reading->index, i).text, "fields of a newer version");
    if (kind->can_have_micromap && row->has_micromap == 0)
        forget_micromap(row);
    if (kind->can_have_micromap && check_micromap(reading, i, row) != BVHD_OK)
        return BVHD_CORRUPT;
    memset(ret_geometry, 0, sizeof *ret_geometry);
    ret_geometry->type = row->type;
    ret_geometry->flags = row->flags;
    ret_geometry->range = (struct geometry_range){
        .primitive_count = row->primitive_count,
        .primitive_offset = row->primitive_offset,
        .first_vertex = row->first_vertex,
        .transform_offset = row->transform_offset,
    };
    kind->from_row(row, ret_geometry);
    return read_arrays(reading, i, row, kind, ret_geometry);
}

static enum bvhd_status refuse_reference(const struct rows_reader *reading, uint32_t i, enum bvhd_status status,
                                         const char *text)
{
    return bvhd_error_set(reading->error, status, place("infos[%u].references[%u]", reading->index, i).text, "%s",
                          text);
}

static enum bvhd_status row_to_reference(const struct rows_reader *reading, uint32_t i, const struct reference_row *row,
                                         struct reference *ret_reference)
{
    if (row->reserved != 0)
        return refuse_reference(reading, i, BVHD_UNSUPPORTED, "fields of a newer version");
    if (row->has_key > 1)
        return refuse_reference(reading, i, BVHD_CORRUPT, "has_key is neither 0 nor 1");
    if (row->moves > 1)
        return refuse_reference(reading, i, BVHD_CORRUPT, "moves is neither 0 nor 1");
    struct reference reference = {.kind = (enum reference_kind)row->kind,
                                  .handle = row->handle,
                                  .moves = row->moves == 1,
                                  .has_key = row->has_key == 1};
    if (reference.has_key)
        memcpy(reference.key.bytes, row->key, sizeof reference.key.bytes);
    memcpy(reference.bounds.min, row->bounds, sizeof reference.bounds.min);
    memcpy(reference.bounds.max, row->bounds + 3, sizeof reference.bounds.max);
    memcpy(&reference.slabs, row->slabs, sizeof reference.slabs);
    *ret_reference = reference;
    return BVHD_OK;
}

static enum bvhd_status read_geometries(const struct rows_reader *reading, const struct row_range *range,
                                        struct geometry *ret_geometries)
{
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < range->count && status == BVHD_OK; i++) {
        struct geometry_row row;
        status = copy_row(reading, range, i, &row);
        if (status == BVHD_OK)
            status = row_to_geometry(reading, i, &row, &ret_geometries[i]);
    }
    return status;
}

static enum bvhd_status read_references(const struct rows_reader *reading, const struct row_range *range,
                                        struct reference *ret_references)
{
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < range->count && status == BVHD_OK; i++) {
        struct reference_row row;
        status = copy_row(reading, range, i, &row);
        if (status == BVHD_OK)
            status = row_to_reference(reading, i, &row, &ret_references[i]);
    }
    return status;
}

enum bvhd_status rows_read(struct bytes payload, const struct rows_shape *shape, uint32_t index, struct memory *memory,
                           struct build_input *input, struct bvhd_error *error)
{
    struct rows_reader reading = {payload, index, shape->cancel, error};
    struct row_range geometry_range = {
        "geometries", shape->geometry_count, shape->geometry_size, sizeof(struct geometry_row), ROWS_GEOMETRY_LEAST, 0};
    struct row_range reference_range = {"references",          shape->reference_count,
                                        shape->reference_size, sizeof(struct reference_row),
                                        ROWS_REFERENCE_LEAST,  (uint64_t)shape->geometry_count * shape->geometry_size};
    enum bvhd_status status = check_range(&reading, &geometry_range);
    if (status == BVHD_OK)
        status = check_range(&reading, &reference_range);
    if (status != BVHD_OK)
        return status;
    struct geometry *geometries = memory_array(memory, geometry_range.count, sizeof *geometries);
    struct reference *references = memory_array(memory, reference_range.count, sizeof *references);
    if ((geometry_range.count > 0 && !geometries) || (reference_range.count > 0 && !references))
        status = bvhd_error_no_memory(error, place("infos[%u]", index).text, "rows");
    if (status == BVHD_OK)
        status = read_geometries(&reading, &geometry_range, geometries);
    if (status == BVHD_OK)
        status = read_references(&reading, &reference_range, references);
    if (status != BVHD_OK) {
        memory_free(memory, geometries);
        memory_free(memory, references);
        return status;
    }
    input->geometry_count = geometry_range.count;
    input->geometries = geometries;
    input->reference_count = reference_range.count;
    input->references = references;
    return BVHD_OK;
}

void rows_finish(struct build_input *input, struct memory *memory)
{
    if (!input)
        return;
    memory_free(memory, (void *)(uintptr_t)input->geometries);
    memory_free(memory, (void *)(uintptr_t)input->references);
    input->geometries = NULL;
    input->references = NULL;
    input->geometry_count = input->reference_count = 0;
}
