/* SPDX-License-Identifier: Apache-2.0 */
/*
 * rows.h - the payload of an item of a build: geometry rows, reference rows, and the data that they point into.
 *
 * Rows have a fixed size, which the item declares, so that they can grow: a reader takes the fields that it knows,
 * treats what a shorter row lacks as 0, and refuses a longer row unless the rest is 0. Spans are offsets from the
 * payload's first byte; offset 0 says "not given" (a NULL pointer), since rows lie there. Little-endian; PROTOCOL.md
 * has the tables. Payloads may change while they are read: every row is copied before it is looked at.
 *
 * A span that is given but empty has an offset that is not 0 and the size 0. Fields and spans that a row's type has no
 * use for are ignored. The contents of fields are validate.h's to judge.
 */
#ifndef BVHD_ROWS_H
#define BVHD_ROWS_H

#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/parallel.h"
#include "proto/base/status.h"

struct row_span {
    uint64_t offset, size;
};

struct geometry_row {
    uint32_t type; /* GEOMETRY_ */
    uint32_t flags;
    uint32_t primitive_count, primitive_offset, first_vertex, transform_offset;
    uint32_t vertex_format, max_vertex, index_type;
    uint32_t reserved; /* 0 */
    uint64_t stride; /* of vertices or boxes */
    struct row_span data; /* vertices, boxes or instance records */
    struct row_span indices;
    struct row_span transform;
};

struct reference_row {
    uint64_t handle;
    uint32_t kind; /* REFERENCE_ */
    uint32_t has_key;
    uint8_t key[KEY_SIZE];
    float bounds[6]; /* minimum, maximum */
    uint64_t reserved; /* 0 */
    float slabs[2 * SLABS_COUNT]; /* minima, maxima (slabs.h); all 0: not known. Shorter rows end before */
};

/*
 * Rows as they are written, and the smallest that a reader takes: those of version 1. Data in payloads starts at
 * multiples of ROWS_ALIGNMENT.
 */
enum {
    ROWS_GEOMETRY_SIZE = 96,
    ROWS_REFERENCE_SIZE = 160,
    ROWS_REFERENCE_LEAST = 80,
    ROWS_MAX_SIZE = 4096,
    ROWS_ALIGNMENT = 16
};

_Static_assert(sizeof(struct geometry_row) == ROWS_GEOMETRY_SIZE && sizeof(struct reference_row) == ROWS_REFERENCE_SIZE,
               "wire format");

/* Bytes of the payload of a description. False when the sum does not fit 64 bits. */
bool rows_payload_size(const struct build_input *input, uint64_t *ret_size);

/*
 * Writes the payload of a description, ROWS_ALIGNMENT-aligned, rows_payload_size bytes; padding is 0. Only the bytes
 * that the ranges reach are worth sending, but what the struct bytes hold is sent: the description decides.
 * Neighbouring geometries that share memory (the same vertices, say) share a span.
 */
void rows_write(const struct build_input *input, unsigned char *payload);

/*
 * The same bytes piece by piece, in order, for who writes them elsewhere than into memory; the bytes of a piece live as
 * long as the call of the sink. What the sink says ends it. BVHD_NO_MEMORY without memory for the rows.
 */
typedef enum bvhd_status (*rows_sink)(void *context, struct bytes piece);
enum bvhd_status rows_stream(const struct build_input *input, struct memory *memory, rows_sink sink, void *context);

/* How the rows of a payload are laid: as the item declares. */
struct rows_shape {
    uint32_t geometry_count, geometry_size; /* rows, bytes of one */
    uint32_t reference_count, reference_size;
    const atomic_bool *cancel; /* may be NULL; looked at every few thousand rows */
};

/*
 * Reads the rows into arrays from `memory` (input->geometries, input->references: rows_finish frees them); other fields
 * of the input are the caller's. Data pointers lead into the payload. BVHD_CORRUPT with the place
 * ("infos[INDEX].geometries[3].indices": outside of the payload; rows outside, or smaller than version 1's),
 * BVHD_UNSUPPORTED for a row with fields that this version does not know, BVHD_TOO_LARGE for row sizes over
 * ROWS_MAX_SIZE, BVHD_NO_MEMORY, BVHD_CANCELLED. On failure the input is as it was. A size of rows that are not there
 * (count 0) is ignored.
 */
enum bvhd_status rows_read(struct bytes payload, const struct rows_shape *shape, uint32_t index, struct memory *memory,
                           struct build_input *input, struct bvhd_error *error);
void rows_finish(struct build_input *input, struct memory *memory);

#endif
