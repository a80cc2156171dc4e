/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable.h - the portable layout: its bytes as structs, and their reader. FORMATS.md has the tables and the reasons.
 * Version 2 adds contents, and version 3 micromaps; a blob has the oldest version that knows what it has.
 *
 * A blob is Vulkan's serialized header, zeros up to a multiple of 64, then the body; offsets in the body count from its
 * start. Nodes are 8-wide, quantised, 80 bytes (Ylitie 2017), with the root first. The contents of leaves are one array
 * of records, 16-byte aligned: indexed triangles (16 bytes) over one array of exact vertices, or fast triangles (48),
 * AABBs (32), instances (128), or spheres or linear swept spheres (8) over one array of centres with radii. Structures
 * that move have nodes of 128 bytes, and motion triangles (16) over vertices with two places, or motion instances
 * (160).
 */
#ifndef BVHD_PORTABLE_H
#define BVHD_PORTABLE_H

#include <stdint.h>

#include "builder/format/serialized.h"
#include "proto/base/box.h"
#include "proto/base/bytes.h"
#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

enum {
    PORTABLE_MICROMAP_VERSION = 3, /* of micromaps, and of triangles with them */
    PORTABLE_NEWEST = PORTABLE_MICROMAP_VERSION, /* the newest version; all from 1 on are known */
    PORTABLE_BODY_ALIGNMENT = 64,
    PORTABLE_LEAF_MAX = 3, /* records per leaf child */
    /* levels of nodes; readers refuse more, so that a stack of this many node groups suffices */
    PORTABLE_MAX_DEPTH = 32,
    /* nodes, and records: leaves two bits of a 32-bit index for a reader's use */
    PORTABLE_MAX_ROWS = 1 << 30
};

extern const uint8_t portable_driver_uuid[16]; /* names the layout family */

/* Makes the compatibility UUID that names a version of the layout. */
void portable_compatibility_uuid(uint32_t version, uint8_t ret_uuid[16]);

/* Returns the version that a compatibility UUID names, or 0 if it is none that is known. */
uint32_t portable_version_of(const uint8_t uuid[16]);

/* Returns where the body begins in a blob with that many handles, which come before it. */
static inline uint64_t portable_body_offset(uint64_t handles)
{
    return bytes_align(SERIALIZED_HANDLES + 8 * handles, PORTABLE_BODY_ALIGNMENT);
}

/* Returns where the body begins in a blob with this header. */
static inline uint64_t portable_body_of(const struct serialized_header *header)
{
    return bytes_align(serialized_end(header), PORTABLE_BODY_ALIGNMENT);
}

/* The kinds of records. */
enum portable_content {
    PORTABLE_INDEXED_TRIANGLES = 0,
    PORTABLE_TRIANGLES = 1,
    PORTABLE_AABBS = 2,
    PORTABLE_INSTANCES = 3,
    PORTABLE_SPHERES = 4, /* this and the following ones since version 2 */
    PORTABLE_SWEPT_SPHERES = 5,
    PORTABLE_MOVING_TRIANGLES = 6,
    PORTABLE_MOVING_INSTANCES = 7,
};

enum { PORTABLE_CONTENTS = PORTABLE_MOVING_INSTANCES + 1 }; /* the number of contents; larger ones are unknown */

enum { PORTABLE_MAGIC = 0x42485642 }; /* "BVHB" */

/* The first 128 bytes of the body. */
struct portable_header {
    uint32_t magic;
    uint32_t version; /* that of the content (record_kind.h), or PORTABLE_MICROMAP_VERSION with micromaps */
    uint32_t content; /* enum portable_content */
    uint32_t build_flags; /* BUILD_ of the request */
    float bounds[6]; /* min xyz, max xyz, exact; min > max when empty */
    uint32_t depth; /* levels of nodes, 0 if empty */
    uint32_t node_count; /* 80 bytes each, of contents that move 128 */
    uint32_t record_count;
    /* indexed triangles: 12 bytes each; spheres and swept spheres: 16; motion triangles: 24; else there are none */
    uint32_t vertex_count;
    uint32_t geometry_count; /* 16 bytes each; bottom level only */
    uint32_t primitive_count; /* as in the request, inactive primitives included */
    /* Offsets from the body's start, multiples of 16. Each section lies inside the body, in this order. */
    uint64_t node_offset;
    uint64_t record_offset;
    uint64_t vertex_offset;
    uint64_t geometry_offset;
    uint64_t body_size;
    /*
     * Version 3: micromaps, and a micromap's index for each primitive, behind the geometries. Older versions have
     * zeros.
     */
    uint64_t micromap_offset;
    uint32_t micromap_count; /* struct portable_micromap, 48 bytes each */
    uint32_t micromap_index_count; /* primitive_count, or 0: then no geometry has micromaps */
    uint32_t reserved[2]; /* 0 */
};

/*
 * One node. Child s has, on each axis a, the box [origin[a] + lo[a][s] * 2^(exponent[a] - 127), origin[a] + hi[a][s] *
 * 2^(exponent[a] - 127)]; exponent 0 means a scale of zero (all boxes are flat at the origin). The boxes are larger
 * than the children by 1/64 of a step on each side (if the scale is not zero), so that a reader's arithmetic may round.
 *
 * Bits 0, 1, 2 of a slot's number stand for +x, +y, +z: children are put into the slots that match the positions of
 * their centres. Visiting the slots in the order s ^ (mask of the ray's negative directions) goes roughly front to
 * back.
 *
 * meta[s]: 0 = empty, with lo 255 and hi 0. Inner child: 0x20 | (24 + s); its node is first_child + the number of inner
 * children in lower slots. Leaf: bits 7..5 are the count in unary (001, 011, 111), bits 4..0 the first record relative
 * to first_record (0 .. 23). Bit s of inner_mask means that slot s is inner. Records are stored in the order of nodes
 * and slots, without gaps: first_record is the number of records of all previous nodes.
 */
struct portable_node {
    float origin[3];
    uint8_t exponent[3];
    uint8_t inner_mask;
    uint32_t first_child;
    uint32_t first_record;
    uint8_t meta[8];
    uint8_t lo[3][8];
    uint8_t hi[3][8];
};

/*
 * One node of a structure that moves. The first part is a node whose boxes are those of t = 0, on a grid that holds the
 * boxes of t = 1, too; these follow. What lies below a child at time t lies in (1 - t) times its box of t = 0 plus t
 * times that of t = 1, up to what the arithmetic of vertices and of a reader rounds.
 */
struct portable_moving_node {
    struct portable_node start;
    uint8_t end_lo[3][8];
    uint8_t end_hi[3][8];
};

/*
 * A vertex of motion triangles, whose records are struct portable_indexed_triangle. Its place at time t is, in float
 * and rounded after each operation, start * (1 - t) + end * t; triangles that share a vertex so agree about it.
 */
struct portable_moving_vertex {
    float start[3], end[3];
};

/*
 * id: bits 28..0 are the flat primitive id (counted through all geometries); bit 31 says that the geometry is opaque;
 * bits 30 and 29 are 0 except in linear swept spheres.
 */
enum { PORTABLE_ID_MASK = 0x1fffffff };
#define PORTABLE_ID_OPAQUE UINT32_C(0x80000000)

struct portable_indexed_triangle {
    uint32_t vertices[3]; /* into the vertex array */
    uint32_t id;
};

struct portable_triangle {
    float v0[3];
    uint32_t id;
    float v1[3];
    uint32_t reserved1; /* 0 */
    float v2[3];
    uint32_t reserved2; /* 0 */
};

struct portable_aabb {
    float min[3];
    uint32_t id;
    float max[3];
    uint32_t reserved; /* 0 */
};

struct portable_instance {
    float object_to_world[12]; /* row-major 3x4, as requested */
    float world_to_object[12]; /* its inverse, computed in double, rounded once */
    uint32_t custom_and_mask; /* as in Vulkan's record: custom index:24, mask:8 */
    uint32_t sbt_and_flags; /* sbt offset:24, flags:8 */
    uint32_t instance; /* its position in the request */
    uint32_t handle; /* row of the serialized header's handles */
    uint32_t reserved[4]; /* 0 */
};

/*
 * A sphere or a linear swept sphere. Vertices have four floats, centre and radius, and are 16-byte aligned. A linear
 * swept sphere's ends are its vertex and the next one; bits 29 and 30 of its id say that the first and the second end
 * have a cap.
 */
struct portable_round {
    uint32_t vertex;
    uint32_t id;
};

#define PORTABLE_ID_CAP_FIRST UINT32_C(0x20000000)
#define PORTABLE_ID_CAP_SECOND UINT32_C(0x40000000)

/* Returns which ends of a linear swept sphere with that id have caps, as swept_shape.h has them: bits 0 and 1. */
static inline unsigned portable_round_caps(uint32_t id)
{
    return id >> 29 & 3;
}

/*
 * An instance of a structure that moves. MOTION_STATIC: start is a row-major 3x4 matrix, and end equals it.
 * MOTION_MATRIX: such matrices at t = 0 and t = 1; each number at time t is computed as those of vertices. MOTION_SRT:
 * the 16 numbers of VkSRTDataNV at t = 0 and t = 1, each as those of vertices; the quaternion counts as divided by its
 * length. Numbers that a type does not use are 0.
 */
struct portable_moving_instance {
    uint32_t motion; /* MOTION_ */
    uint32_t custom_and_mask; /* this and the next three as in struct portable_instance */
    uint32_t sbt_and_flags;
    uint32_t instance;
    uint32_t handle;
    uint32_t reserved[3]; /* 0; on a device the last two are the location of the bottom level's body */
    float start[16], end[16];
};

enum { PORTABLE_MATRIX = 12, PORTABLE_SRT = 16 }; /* how many numbers a matrix or VkSRTDataNV has */

_Static_assert(sizeof(struct portable_moving_node) == 128 && sizeof(struct portable_moving_vertex) == 24, "layout");
_Static_assert(sizeof(struct portable_moving_instance) == 160, "layout");

/* A geometry covers the flat ids first_primitive .. first_primitive + primitive_count - 1. */
struct portable_geometry {
    uint32_t flags; /* GEOMETRY_ */
    uint32_t first_primitive;
    uint32_t primitive_count;
    /* 0: none; 1 .. micromap_count: row + 1; PORTABLE_NO_MICROMAP: none, but its triangles have special indices */
    uint32_t micromap;
};

/*
 * Version 3: triangles with micromaps (VK_EXT_opacity_micromap). A triangle whose id has PORTABLE_ID_MICROMAP has an
 * index, at its flat primitive id: a special one (MICROMAP_FULLY_), or the number of a triangle of its geometry's
 * micromap. It decides the opacity of hits instead of bit 31, which says that the geometry is opaque, unless the
 * instance disables micromaps. Indices of other primitives are 0.
 */
#define PORTABLE_ID_MICROMAP UINT32_C(0x40000000)
#define PORTABLE_NO_MICROMAP UINT32_C(0xffffffff)

/* A micromap that triangles of the structure name. Its bytes are a blob of their own (portable_micromap.h). */
struct portable_micromap {
    uint8_t key[32]; /* of the micromap */
    uint32_t handle; /* its row among the serialized header's addresses */
    uint32_t triangle_count;
    uint32_t location[2]; /* 0; on a device the location of the micromap's body */
};

_Static_assert(sizeof(struct portable_header) == 128 && sizeof(struct portable_node) == 80, "layout");
_Static_assert(sizeof(struct portable_indexed_triangle) == 16 && sizeof(struct portable_triangle) == 48, "layout");
_Static_assert(sizeof(struct portable_aabb) == 32 && sizeof(struct portable_instance) == 128, "layout");
_Static_assert(sizeof(struct portable_micromap) == 48, "layout");
_Static_assert(sizeof(struct portable_round) == 8 && sizeof(struct portable_geometry) == 16, "layout");

/*
 * A blob opened for reading. All pointers lead into the blob, which must be 16-byte aligned, stay unchanged and outlive
 * the view.
 */
struct portable_view {
    const struct portable_header *header;
    /* of a content that moves they begin struct portable_moving_node, and portable_node_at finds each */
    const struct portable_node *nodes;
    uint32_t node_size; /* bytes from one node to the next */
    const void *records; /* their type depends on header->content */
    const float *vertices;
    const struct portable_geometry *geometries;
    const unsigned char *handles; /* handle_count u64 */
    uint64_t handle_count;
    const struct portable_micromap *micromaps; /* header->micromap_count */
    const uint32_t *micromap_indices; /* header->micromap_index_count */
};

/* Returns node `index`, of any content. */
static inline const struct portable_node *portable_node_at(const struct portable_view *view, uint32_t index)
{
    const void *node = (const unsigned char *)view->nodes + (uint64_t)view->node_size * index;
    return node;
}

/*
 * Opens a hostile blob. It checks the header and every section's place, every node (children follow their parent and
 * have one parent each, records have one owner each, the depth is bounded), and every record's ids and indices, so that
 * traverse.h reads without further checks and terminates. Takes O(size) time. Returns BVHD_CORRUPT or BVHD_INCOMPATIBLE
 * with the place, e.g. "nodes[17].firstChild"; BVHD_NO_MEMORY. `memory` provides the levels of the nodes, which are
 * freed before return.
 */
enum bvhd_status portable_open(struct bytes blob, struct memory *memory, struct portable_view *ret_view,
                               struct bvhd_error *error);

/*
 * Opens only the headers, the places of the sections, and the geometries of a hostile blob. Whoever reads nodes and
 * records then checks each of them.
 */
enum bvhd_status portable_open_sections(struct bytes blob, struct portable_view *ret_view, struct bvhd_error *error);

/* Returns the geometry of a flat primitive id. */
uint32_t portable_geometry_of(const struct portable_view *view, uint32_t id);

#endif
