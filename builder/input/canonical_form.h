/* SPDX-License-Identifier: Apache-2.0 */
/*
 * canonical_form.h - the bytes of a canonical copy: FORMATS.md's tables as structs. Shared by prepare.c, which writes
 * them, and prepare_open.c, which reads them back; everybody else uses canonical.h.
 *
 * Header, geometry rows, arrays of primitives (indices, boxes, instance records) in the order of geometries, positions
 * in the order of geometries, reference rows. Every part starts at a multiple of 16 and what lies between is 0. Nothing
 * is free to choose: equal requests give equal bytes, and a reader can tell from the counts where everything must be.
 */
#ifndef BVHD_CANONICAL_FORM_H
#define BVHD_CANONICAL_FORM_H

#include "builder/format/canonical.h"

enum { FORM_ALIGNMENT = 16, FORM_RECORD_SIZE = 64, FORM_RECORD_REFERENCE = 56 };

static const char form_magic[4] = {'B', 'V', 'H', 'C'};

struct form_header {
    char magic[4]; /* "BVHC" */
    uint32_t version; /* CANONICAL_VERSION */
    uint32_t type; /* STRUCTURE_TOP or STRUCTURE_BOTTOM */
    uint32_t flags; /* BUILD_ */
    uint32_t geometry_count;
    uint32_t reference_count;
    uint32_t primitive_count; /* over all geometries */
    uint32_t vertex_count; /* over all geometries */
    uint64_t size; /* of the whole block */
    uint64_t reference_offset; /* of the reference rows; 0 without any */
    uint64_t reserved[2]; /* 0 */
};

/* What an update compares (row F16); all 0 unless the build says ALLOW_UPDATE and the geometry has triangles. */
enum { FORM_UPDATE_RECORDED = 1, FORM_UPDATE_TRANSFORM = 2 /* transformData was not NULL */ };

struct form_geometry {
    uint32_t type; /* GEOMETRY_ */
    uint32_t flags; /* GEOMETRY_OPAQUE, ... */
    uint32_t primitive_count;
    uint32_t vertex_count; /* triangles only */
    uint64_t data_offset; /* of positions, boxes or records; 0 when there are none */
    uint64_t index_offset; /* of indices; 0 when there are none */
    uint32_t indexed; /* 1: three indices a triangle; 0: triangle i is vertices 3i .. 3i+2 */
    uint32_t update; /* FORM_UPDATE_ */
    uint32_t vertex_format; /* these four only with FORM_UPDATE_RECORDED */
    uint32_t max_vertex;
    uint32_t index_type;
    uint32_t lowest_index; /* as given, where index 0 was before indices were counted from there */
    uint32_t reserved[2]; /* 0 */
};

struct form_reference {
    uint32_t kind; /* REFERENCE_ */
    uint32_t reserved; /* 0 */
    struct key key; /* all zero when only bounds were given */
    struct box bounds; /* finite; box_empty() for an empty structure */
    struct slabs slabs; /* valid; all 0 when they are not known, and for an empty structure */
};

_Static_assert(sizeof(struct form_header) == 64 && sizeof(struct form_geometry) == 64, "format");
_Static_assert(sizeof(struct form_reference) == 144, "format");

enum form_part { FORM_PRIMITIVES, FORM_POSITIONS };

/* Bytes of a geometry's array in one part; 0 for none. */
uint64_t form_bytes(const struct form_geometry *row, enum form_part part);

/* The offset of that array in its row; NULL where the part is not this geometry's business. */
uint64_t *form_offset(struct form_geometry *row, enum form_part part);

/*
 * Places a part's arrays from `at` on, writing their offsets into the rows. False when the sum does not fit 64 bits.
 * *ret_end: where the next part starts, a multiple of 16 when `at` is.
 */
bool form_place(struct form_geometry *rows, uint32_t count, enum form_part part, uint64_t at, uint64_t *ret_end);

/*
 * Fills the view of a complete and correct block: everything but the pointers of its two tables, which the caller has
 * allocated (NULL for none), is overwritten, and so are the tables' contents.
 */
void form_view(const unsigned char *block, struct canonical *view);

/* Bounds that a reference may have: finite, and box_empty() when they are empty. */
bool form_bounds_valid(const struct box *bounds);

/*
 * Slabs that a reference with these bounds may have: valid, and all bits 0 when they are not known or the bounds are
 * empty.
 */
bool form_slabs_valid(const struct slabs *slabs, const struct box *bounds);

#endif
