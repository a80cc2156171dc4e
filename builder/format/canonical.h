/* SPDX-License-Identifier: Apache-2.0 */
/*
 * canonical.h - the canonical copy: the private normalised copy of a request's geometry. It holds everything that
 * decides the result, and nothing else.
 *
 * It is one block of versioned little-endian bytes (FORMATS.md has the table): header, geometry table, each geometry's
 * arrays, reference table. prepare.h writes it from a description; content_key.h hashes it; the builder reads it
 * through this view. It can also travel between machines, so prepare_open() treats it as hostile.
 *
 * Triangles: positions are three floats each, after the geometry transform, from the lowest to the highest index in
 * use; indices are u32 (three per triangle) or absent (triangle i has the vertices 3i..3i+2). AABBs: six floats each.
 * Instances: 64-byte records as in Vulkan, whose reference field is the 1-based row of the reference table, or 0 for an
 * inactive instance. Spheres: four floats a vertex, its centre and its radius; indices are u32 (one a sphere) or absent
 * (sphere i is vertex i). Linear swept spheres: the same vertices, and one u32 each, the number of its first end, whose
 * successor is its second end, with the bits CANONICAL_CAP_FIRST and CANONICAL_CAP_SECOND for the ends that have a cap.
 * Motion triangles: as triangles, and behind all positions of t = 0 those of t = 1. Motion instances: 160-byte records
 * as in Vulkan, whose reference is the 1-based row, and whose unused bytes and flags are 0.
 */
#ifndef BVHD_CANONICAL_H
#define BVHD_CANONICAL_H

#include "proto/base/geometry.h"
#include "proto/base/status.h"

/*
 * A block has the oldest version that can express it: spheres, linear swept spheres and the flag BUILD_MOTION need
 * version 3; micromaps, and triangles with them, need version 4.
 */
enum { CANONICAL_VERSION = 2, CANONICAL_VERSION_ROUND = 3, CANONICAL_VERSION_MICROMAP = 4 };

/* The index of a linear swept sphere: whether its ends have caps, and its first end. */
#define CANONICAL_CAP_FIRST UINT32_C(0x40000000)
#define CANONICAL_CAP_SECOND UINT32_C(0x80000000)
#define CANONICAL_END_MASK UINT32_C(0x3fffffff)

/* One geometry of a canonical copy. Pointers lead into the block, and are at least 16-byte aligned if the block is. */
struct canonical_geometry {
    uint32_t type; /* GEOMETRY_ */
    uint32_t flags; /* GEOMETRY_OPAQUE | GEOMETRY_NO_DUPLICATE_ANY_HIT */
    uint32_t primitive_count; /* of any kind, inactive ones included */
    uint32_t first_primitive; /* sum of primitive_count over the previous geometries: the flat id of its primitive 0 */
    uint32_t vertex_count; /* 0 for kinds without vertices */
    uint32_t first_vertex; /* sum of vertex_count over the previous geometries */
    /* motion triangles: the positions at t = 1, vertex_count * 3; NULL: the vertices do not move */
    const float *end_positions;
    const float *positions; /* triangles: vertex_count * 3; spheres and linear swept spheres: vertex_count * 4 */
    /*
     * triangles: primitive_count * 3 indices, each < vertex_count; NULL: vertex_count = 3 * primitive_count. Spheres:
     * primitive_count, each < vertex_count; NULL: vertex_count = primitive_count. Linear swept spheres:
     * primitive_count, each end < vertex_count - 1; NULL only if there are none.
     */
    const uint32_t *indices;
    const float *boxes; /* AABBs: primitive_count * 6 */
    const unsigned char *instances; /* instances: primitive_count * 64 bytes; motion instances: * 160 */
    /*
     * Triangles with a micromap: primitive_count indices, special ones (MICROMAP_FULLY_) or numbers of the micromap's
     * triangles; NULL: they have none. `micromap` is the micromap's 1-based row of the reference table; 0: none, and
     * all indices are special.
     */
    const uint32_t *micromap_indices;
    uint32_t micromap;
    bool has_micromaps; /* micromap_indices are there; they may be NULL if there are no primitives */
    /* The states of whole triangles are final: none in the tree is transparent, and opaque ones have no index. */
    bool resolves_micromaps;
    /* a micromap: primitive_count triangles, whose states are in `states`, vertex_count bytes */
    const struct micromap_triangle *micro_triangles;
    const unsigned char *states;
};

/* One row of the reference table: a bottom-level structure that instances name, or a micromap that triangles name. */
struct canonical_reference {
    enum reference_kind kind;
    uint32_t triangle_count; /* of a micromap, which has neither bounds nor slabs */
    struct key key; /* all zero if only bounds are known */
    struct box bounds; /* empty box: an empty structure */
    struct slabs slabs; /* all 0: unknown */
};

/* A view of a canonical copy. */
struct canonical {
    const unsigned char *bytes; /* the whole block */
    uint64_t size;
    uint32_t type; /* STRUCTURE_TOP or STRUCTURE_BOTTOM */
    uint32_t flags; /* BUILD_ */
    uint32_t geometry_count;
    uint32_t reference_count;
    uint32_t primitive_count; /* over all geometries */
    uint32_t vertex_count; /* over all geometries */
    struct canonical_geometry *geometries; /* parsed tables; they belong to the creator of the view */
    struct canonical_reference *references;
    unsigned char *owned; /* `bytes` if it belongs to the view, else NULL */
    /*
     * Ignore the references' slabs: a native layout needs instance boxes as large as the driver's, which follow from
     * the bounds.
     */
    bool ignores_slabs;
};

/* The fields of a Vulkan instance record, bit exact. */
struct canonical_instance {
    /* row-major 3x4, object to world; of a motion instance that of t = 0, and of one that an SRT moves zeros */
    float transform[12];
    uint32_t custom_index; /* 24 bits */
    uint32_t mask; /* 8 bits */
    uint32_t sbt_offset; /* 24 bits */
    uint32_t flags; /* 8 bits, INSTANCE_ */
    uint64_t reference; /* 1-based row of the reference table; 0: inactive */
};

/* Unpacks instance `index` of an instances or a motion instances geometry. */
struct canonical_instance canonical_instance(const struct canonical_geometry *geometry, uint32_t index);

/*
 * The numbers of an instance at t = 0 and t = 1: of MOTION_STATIC and MOTION_MATRIX the first 12, and of a static one
 * the same twice; of MOTION_SRT those of VkSRTDataNV (srt.h). Numbers that the type does not use are 0.
 */
struct canonical_motion {
    uint32_t type; /* MOTION_ */
    float start[16], end[16];
};

/* Unpacks how instance `index` of an instances or a motion instances geometry moves. */
struct canonical_motion canonical_motion(const struct canonical_geometry *geometry, uint32_t index);

/*
 * Returns where the other fields begin after the numbers of a record of an instances geometry of this GEOMETRY_ type.
 */
static inline uint32_t canonical_record_fields(uint32_t geometry_type, const unsigned char *record)
{
    static const uint32_t motion_fields[MOTION_TYPES] = {MOTION_RECORD_DATA + 48, MOTION_RECORD_DATA + 2 * 48,
                                                         MOTION_RECORD_DATA + 2 * 64};
    return geometry_type == GEOMETRY_MOVING_INSTANCES ? motion_fields[bytes_get32(record)] : 48;
}

/* Returns whether any geometry has a micromap, or special indices instead of one. */
bool canonical_has_micromaps(const struct canonical *canonical);

/* Returns whether triangle `index` of a geometry is in no tree because rays pass through all of it. */
static inline bool canonical_is_transparent(const struct canonical_geometry *geometry, uint32_t index)
{
    return geometry->resolves_micromaps && geometry->micromap_indices[index] == MICROMAP_FULLY_TRANSPARENT;
}

/* Returns whether anything in a structure moves, so that its boxes have two keys. */
bool canonical_moves(const struct canonical *canonical);

/* Returns the positions of a triangles or a motion triangles geometry at t = 0 (key 0) or t = 1 (key 1). */
static inline const float *canonical_positions(const struct canonical_geometry *geometry, int key)
{
    return key == 1 && geometry->end_positions ? geometry->end_positions : geometry->positions;
}

/* Copies the three corners of triangle `index` at t = 0 (key 0) or t = 1 (key 1). */
static inline void canonical_triangle_at(const struct canonical_geometry *geometry, uint32_t index, int key,
                                         float ret_corners[3][3])
{
    const float *positions = canonical_positions(geometry, key);
    for (int k = 0; k < 3; k++) {
        uint32_t vertex = geometry->indices ? geometry->indices[(uint64_t)3 * index + k] : 3 * index + k;
        memcpy(ret_corners[k], positions + (uint64_t)3 * vertex, 3 * sizeof(float));
    }
}

/* Copies the three corners of triangle `index` of a geometry that does not move. */
static inline void canonical_triangle(const struct canonical_geometry *geometry, uint32_t index,
                                      float ret_corners[3][3])
{
    canonical_triangle_at(geometry, index, 0, ret_corners);
}

/*
 * Returns the geometry of the flat primitive id `primitive`: the largest non-empty g with first_primitive <= primitive.
 */
uint32_t canonical_geometry_of(const struct canonical *canonical, uint32_t primitive);

/*
 * Returns the GEOMETRY_ that decides what structure it becomes: that of the first geometry that moves, else that of the
 * first geometry, which all have. A copy without geometries counts as one of triangles, or of instances.
 */
uint32_t canonical_kind(const struct canonical *canonical);

#endif
