/* SPDX-License-Identifier: Apache-2.0 */
/*
 * rows.h - reads and writes the payload of one item of a build: geometry rows, reference rows, and the data that they
 * point to.
 *
 * Rows have a fixed size, which the item declares, so that later versions can extend them: a reader takes the fields
 * that it knows, treats fields that a shorter row lacks as 0, and refuses a longer row unless the rest is 0. Spans are
 * offsets from the payload's first byte. Offset 0 means "not given" (a NULL pointer), because rows lie there; a span
 * that is given but empty has another offset and the size 0. Everything is little-endian; PROTOCOL.md has the tables.
 *
 * A payload may change while it is read, so that every row is copied before it is checked. Fields and spans that a
 * row's type does not use are ignored. Validation (validate.h) judges the contents of fields.
 */
#ifndef BVHD_ROWS_H
#define BVHD_ROWS_H

#include <stddef.h>

#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/parallel.h"
#include "proto/base/status.h"

/* A range of the payload in bytes. */
struct row_span {
    uint64_t offset, size;
};

/* One geometry in its wire format; fields as in struct geometry. */
struct geometry_row {
    uint32_t type; /* GEOMETRY_ */
    uint32_t flags;
    uint32_t primitive_count, primitive_offset, first_vertex, transform_offset;
    uint32_t vertex_format, max_vertex, index_type;
    uint32_t reserved; /* 0 */
    uint64_t stride; /* bytes, of vertices, boxes, a micromap's triangles or rows of texels */
    struct row_span data; /* vertices, boxes, instance records, states of a micromap or rows of texels */
    struct row_span indices;
    struct row_span transform;
    /* Shorter rows end before these fields. */
    uint32_t radius_format, indexing_mode, end_caps_mode;
    uint32_t reserved_round; /* 0 */
    uint64_t index_stride, radius_stride; /* bytes */
    struct row_span radii;
    struct row_span end_positions; /* of motion triangles: the vertices at t = 1 */
    /* Rows without micromaps end before these fields, which are those of struct triangle_micromap. */
    uint32_t has_micromap, has_usages; /* 0 or 1 */
    uint32_t micromap_index_type, base_triangle;
    uint64_t micromap;
    uint64_t micromap_stride; /* bytes */
    struct row_span usages; /* of micromaps, too */
    struct row_span micromap_indices;
    /* Rows of triangles end before these fields: of a micromap and, from the next line on, of a baked one. */
    struct row_span micromap_triangles;
    uint32_t alpha_width, alpha_height, wrap_u, wrap_v;
    uint32_t is_nearest, bake_mode, micromap_format, micromap_level;
    float alpha_cutoff;
    uint32_t vertex_count;
    uint64_t coordinate_stride; /* bytes */
    struct row_span coordinates;
};

/* One reference in its wire format; fields as in struct reference. */
struct reference_row {
    uint64_t handle;
    uint32_t kind; /* REFERENCE_ */
    uint32_t has_key;
    uint8_t key[KEY_SIZE];
    float bounds[6]; /* minimum, maximum */
    uint32_t moves; /* 0 or 1 */
    uint32_t reserved; /* 0 */
    float slabs[2 * SLABS_COUNT]; /* minima, maxima (slabs.h); all 0: unknown. Shorter rows end before this field. */
};

/*
 * The sizes of rows with all fields, and the smallest sizes that a reader accepts: those of version 1. Between them are
 * those that end where other fields begin. Data in payloads starts at multiples of ROWS_ALIGNMENT.
 */
enum {
    ROWS_GEOMETRY_SIZE = 304,
    ROWS_GEOMETRY_MICROMAP = 240,
    ROWS_GEOMETRY_ATTACHED = 224,
    ROWS_GEOMETRY_ROUND = 160,
    ROWS_GEOMETRY_LEAST = 96,
    ROWS_REFERENCE_SIZE = 160,
    ROWS_REFERENCE_LEAST = 80,
    ROWS_MAX_SIZE = 4096,
    ROWS_ALIGNMENT = 16
};

_Static_assert(sizeof(struct geometry_row) == ROWS_GEOMETRY_SIZE && sizeof(struct reference_row) == ROWS_REFERENCE_SIZE,
               "wire format");
_Static_assert(offsetof(struct geometry_row, alpha_width) == ROWS_GEOMETRY_MICROMAP &&
                   offsetof(struct geometry_row, micromap_triangles) == ROWS_GEOMETRY_ATTACHED &&
                   offsetof(struct geometry_row, has_micromap) == ROWS_GEOMETRY_ROUND &&
                   offsetof(struct geometry_row, radius_format) == ROWS_GEOMETRY_LEAST,
               "where rows end");

/*
 * Returns how many bytes each geometry row of the description's payload has: ROWS_GEOMETRY_LEAST, which every daemon
 * understands, unless a kind of geometry, or a micromap that is attached to one, needs more.
 */
uint32_t rows_geometry_size(const struct build_input *input);

/* Computes the size of a description's payload in bytes. Returns false if it does not fit 64 bits. */
bool rows_payload_size(const struct build_input *input, uint64_t *ret_size);

/*
 * Writes a description's payload of rows_payload_size bytes to memory that is aligned to ROWS_ALIGNMENT; padding is 0.
 * All bytes of the description's struct bytes are written, whether or not its ranges reach them. Neighbouring
 * geometries that share memory (the same vertices, say) share a span.
 */
void rows_write(const struct build_input *input, unsigned char *payload);

/*
 * Passes the same bytes piece by piece, in order, to a sink that does not write to memory. A piece's bytes live as long
 * as the call of the sink. A sink that fails ends the streaming with its status. BVHD_NO_MEMORY if there is no memory
 * for the rows.
 */
typedef enum bvhd_status (*rows_sink)(void *context, struct bytes piece);
enum bvhd_status rows_stream(const struct build_input *input, struct memory *memory, rows_sink sink, void *context);

/* The shape of a payload's rows, as its item declares it. */
struct rows_shape {
    uint32_t geometry_count, geometry_size; /* number of rows, bytes of one */
    uint32_t reference_count, reference_size;
    const atomic_bool *cancel; /* may be NULL; checked once every few thousand rows */
};

/*
 * Reads the rows into arrays from `memory` (input->geometries, input->references), which rows_finish frees; the other
 * fields of the input belong to the caller. Data pointers lead into the payload. A row size is ignored if there are no
 * such rows.
 *
 * Fails, and leaves the input as it was, with BVHD_CORRUPT and the place (a span such as
 * "infos[INDEX].geometries[3].indices" outside of the payload, rows outside of it, or rows smaller than version 1's),
 * BVHD_UNSUPPORTED if a row has fields that this version does not know, BVHD_TOO_LARGE for row sizes over
 * ROWS_MAX_SIZE, BVHD_NO_MEMORY, BVHD_CANCELLED.
 */
enum bvhd_status rows_read(struct bytes payload, const struct rows_shape *shape, uint32_t index, struct memory *memory,
                           struct build_input *input, struct bvhd_error *error);
void rows_finish(struct build_input *input, struct memory *memory);

#endif
