/* SPDX-License-Identifier: Apache-2.0 */
/*
 * canonical_form.h - defines the bytes of a canonical copy: the tables of FORMATS.md as structs. Only prepare.c, which
 * writes them, prepare_open.c, which reads them back, and the modules that fill sections of them or go through them
 * include this header; all other code uses canonical.h.
 *
 * A block holds, in this order: the header; the geometry rows; the arrays of primitives (indices, boxes, instance
 * records, triangles of a micromap); the indices of micromaps on triangles; the positions, or a micromap's states; the
 * reference rows. Arrays of one sort are in the order of the geometries. Every section starts at a multiple of 16, and
 * the bytes between sections are 0. Nothing is left to the writer's choice: equal requests give equal bytes,
 * and a reader can compute from the counts where everything must be.
 */
#ifndef BVHD_CANONICAL_FORM_H
#define BVHD_CANONICAL_FORM_H

#include "builder/format/canonical.h"

enum { FORM_ALIGNMENT = 16, FORM_RECORD_SIZE = 64 };

static const char form_magic[4] = {'B', 'V', 'H', 'C'};

struct form_header {
    char magic[4]; /* "BVHC" */
    uint32_t version; /* CANONICAL_VERSION_, the oldest that has what the block has */
    uint32_t type; /* STRUCTURE_TOP, STRUCTURE_BOTTOM or STRUCTURE_MICROMAP */
    uint32_t flags; /* BUILD_ */
    uint32_t geometry_count;
    uint32_t reference_count;
    uint32_t primitive_count; /* sum over all geometries */
    uint32_t vertex_count; /* sum over all geometries */
    uint64_t size; /* bytes of the whole block */
    uint64_t reference_offset; /* offset of the reference rows; 0 without any */
    uint64_t reserved[2]; /* must be 0 */
};

/*
 * Fields that an update compares with the build's (Vulkan specification, VkAccelerationStructureBuildGeometryInfoKHR,
 * rules for mode UPDATE). They are 0 unless the build says ALLOW_UPDATE and the geometry has vertices.
 */
enum { FORM_UPDATE_RECORDED = 1, FORM_UPDATE_TRANSFORM = 2 /* transformData was not NULL */ };

/* How linear swept spheres were given: SWEPT_SUCCESSIVE instead of a list, and SWEPT_CAPS_CHAINED instead of none. */
enum { FORM_SWEPT_SUCCESSIVE = 1, FORM_SWEPT_CHAINED = 2 };

struct form_geometry {
    uint32_t type; /* GEOMETRY_ */
    uint32_t flags; /* GEOMETRY_OPAQUE, ... */
    uint32_t primitive_count;
    uint32_t vertex_count; /* 0 unless the geometry has vertices */
    /*
     * Offset of positions, boxes or records; 0 when there are none. Motion triangles: all positions of t = 0, then all
     * of t = 1.
     */
    uint64_t data_offset;
    uint64_t index_offset; /* offset of indices; 0 when there are none */
    uint32_t indexed; /* 1: there are indices; 0: triangle i is made of vertices 3i .. 3i+2, sphere i is vertex i */
    uint32_t update; /* FORM_UPDATE_ */
    uint32_t vertex_format; /* this field and those after it are 0 without FORM_UPDATE_RECORDED */
    uint32_t max_vertex; /* triangles */
    uint32_t index_type;
    /*
     * The lowest index in the request, from which the copy's indices count. Linear swept spheres whose pairs were
     * gathered have a checksum of the request's indices here, because the copy does not show them.
     */
    uint32_t lowest_index;
    union {
        struct { /* spheres and linear swept spheres */
            uint32_t radius_format;
            uint32_t swept_modes; /* linear swept spheres: FORM_SWEPT_ */
        };
        /* Triangles: offset of struct form_micromap; 0 when they have no micromap. It is 0 in other geometries. */
        uint64_t micromap_offset;
    };
};

/* The micromap of triangles, which an index for each of them follows. */
struct form_micromap {
    uint32_t reference; /* 1-based row of the reference table; 0: none, and all indices are special */
    uint32_t reserved; /* must be 0 */
    /*
     * With MICROMAP_DATA_UPDATE, a checksum of what such updates must not change: which indices are special, and format
     * and level of the triangles that the others name. Else 0.
     */
    uint64_t shape_sum;
};

struct form_reference {
    uint32_t kind; /* REFERENCE_ */
    uint32_t triangle_count; /* of a micromap; else 0 */
    struct key key; /* all zero when only bounds were given */
    struct box bounds; /* finite; box_empty() for an empty structure */
    struct slabs slabs; /* valid; all 0 when they are not known, and for an empty structure */
};

_Static_assert(sizeof(struct form_header) == 64 && sizeof(struct form_geometry) == 64, "format");
_Static_assert(sizeof(struct form_reference) == 144 && sizeof(struct form_micromap) == 16, "format");

/* Makes the row of the reference table for a micromap, of which the key and the number of triangles are given. */
struct form_reference form_micromap_reference(const struct key *key, uint32_t triangle_count);

/* Returns the version of a block with these rows and BUILD_ flags. */
uint32_t form_version(const struct form_geometry *rows, uint32_t count, uint32_t flags);

/* Returns the row of a geometry of a block that has been checked so far. */
static inline const struct form_geometry *form_row(const struct canonical *canonical, uint32_t geometry)
{
    return (const struct form_geometry *)(const void *)(canonical->bytes + sizeof(struct form_header)) + geometry;
}

enum form_section { FORM_PRIMITIVES, FORM_MICROMAPS, FORM_POSITIONS };

/* Stands in a row for the offset of a micromap that is there, until form_place writes it. */
enum { FORM_UNPLACED = 1 };

/* Returns whether a geometry of this type may have a micromap: it consists of triangles. */
bool form_may_have_micromap(uint32_t type);

/* Returns the size in bytes of a geometry's array in one section; 0 when it has none. */
uint64_t form_bytes(const struct form_geometry *row, enum form_section section);

/* Returns the field of the row that holds the array's offset; NULL when the geometry has no array in that section. */
uint64_t *form_offset(struct form_geometry *row, enum form_section section);

/*
 * Places a section's arrays one after the other from offset `at`, and writes their offsets into the rows. Returns false
 * when the sum does not fit 64 bits. *ret_end: where the next section starts; a multiple of 16 when `at` is.
 */
bool form_place(struct form_geometry *rows, uint32_t count, enum form_section section, uint64_t at, uint64_t *ret_end);

/*
 * Makes the view of a complete and valid block. The caller has allocated the view's two tables (NULL for an empty one);
 * everything else in the view, and the contents of the tables, are overwritten.
 */
void form_view(const unsigned char *block, struct canonical *view);

/* True for bounds that a reference is allowed to have: finite, and equal to box_empty() when they are empty. */
bool form_bounds_valid(const struct box *bounds);

/*
 * True for slabs that a reference with these bounds is allowed to have: valid, and all bits 0 when they are not known
 * or the bounds are empty.
 */
bool form_slabs_valid(const struct slabs *slabs, const struct box *bounds);

/* Report a field, of the block or of one of its rows, that prepare() would not have written. Return BVHD_CORRUPT. */
enum bvhd_status form_corrupt(struct bvhd_error *error, const char *where, const char *text);
enum bvhd_status form_corrupt_row(struct bvhd_error *error, uint32_t row, const char *field, const char *text);

#endif
