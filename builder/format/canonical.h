/* SPDX-License-Identifier: Apache-2.0 */
/*
 * canonical.h - the canonical form of a request: what was asked, reduced to what decides the answer.
 *
 * One block of versioned little-endian bytes (FORMATS.md has the table): header, geometry table, each geometry's
 * arrays, reference table. prepare.h writes it from a description; content_key.h hashes it; the builder reads it
 * through this view; it is also what travels between machines, so prepare_open() treats it as hostile.
 *
 * Triangles: positions are three floats each, after the geometry transform, from the lowest index in use up to the
 * highest index in use; indices are u32 (three a triangle) or absent (triangle i = vertices 3i..3i+2). AABBs: six
 * floats each. Instances: 64-byte records as in Vulkan whose reference field is the 1-based row of the reference table,
 * 0 for an inactive instance.
 */
#ifndef BVHD_CANONICAL_H
#define BVHD_CANONICAL_H

#include "proto/base/geometry.h"
#include "proto/base/status.h"

enum { CANONICAL_VERSION = 2 };

/* One geometry of a canonical copy; pointers lead into the block and are at least 16-byte aligned when the block is. */
struct canonical_geometry {
    uint32_t type; /* GEOMETRY_ */
    uint32_t flags; /* GEOMETRY_OPAQUE, ... */
    uint32_t primitive_count; /* triangles, boxes or instances, inactive ones included */
    uint32_t first_primitive; /* sum of primitive_count over the geometries before it: the flat id of its primitive 0 */
    uint32_t vertex_count; /* triangles only */
    uint32_t first_vertex; /* sum of vertex_count over the geometries before it */
    const float *positions; /* triangles: vertex_count * 3 */
    /* triangles: primitive_count * 3, each < vertex_count; or NULL: vertex_count = 3 * primitive_count */
    const uint32_t *indices;
    const float *boxes; /* AABBs: primitive_count * 6 */
    const unsigned char *instances; /* instances: primitive_count * 64 bytes */
};

struct canonical_reference {
    enum reference_kind kind;
    struct key key; /* all zero when only bounds were given */
    struct box bounds; /* empty box: an empty structure */
    struct slabs slabs; /* all 0: not known */
};

struct canonical {
    const unsigned char *bytes; /* the whole block */
    uint64_t size;
    uint32_t type; /* STRUCTURE_TOP or STRUCTURE_BOTTOM */
    uint32_t flags; /* BUILD_ */
    uint32_t geometry_count;
    uint32_t reference_count;
    uint32_t primitive_count; /* over all geometries */
    uint32_t vertex_count; /* over all geometries */
    struct canonical_geometry *geometries; /* parsed tables; owned by whoever made the view */
    struct canonical_reference *references;
    unsigned char *owned; /* `bytes` when it belongs to the view, else NULL */
    /*
     * of references: a native layout needs boxes of instances as large as the driver's, which are those of the bounds
     */
    bool ignores_slabs;
};

/* The Vulkan instance record as fields, bit exact (row F11). */
struct canonical_instance {
    float transform[12]; /* row-major 3x4, object to world */
    uint32_t custom_index; /* 24 bits */
    uint32_t mask; /* 8 bits */
    uint32_t sbt_offset; /* 24 bits */
    uint32_t flags; /* 8 bits, INSTANCE_ */
    uint64_t reference; /* 1-based row of the reference table; 0: inactive */
};

/* Instance `index` of an instances geometry. */
struct canonical_instance canonical_instance(const struct canonical_geometry *geometry, uint32_t index);

/* The three corners of triangle `index`. */
static inline void canonical_triangle(const struct canonical_geometry *geometry, uint32_t index,
                                      float ret_corners[3][3])
{
    for (int k = 0; k < 3; k++) {
        uint32_t vertex = geometry->indices ? geometry->indices[(uint64_t)3 * index + k] : 3 * index + k;
        memcpy(ret_corners[k], geometry->positions + (uint64_t)3 * vertex, 3 * sizeof(float));
    }
}

/*
 * The geometry that flat primitive id `primitive` belongs to: largest g with first_primitive <= primitive and
 * primitives in it.
 */
uint32_t canonical_geometry_of(const struct canonical *canonical, uint32_t primitive);

#endif
