/* SPDX-License-Identifier: Apache-2.0 */
/*
 * geometry.h - what a request asks for: the neutral description of one acceleration structure.
 *
 * It holds the contents of VkAccelerationStructureBuildGeometryInfoKHR and its range infos, with two differences: a
 * pointer comes with the number of bytes that can be read there, and an instance's reference is looked up in a table of
 * structures that the caller knows. Enumerants and flag bits have Vulkan's values. Nothing here is trusted: validate.h
 * and prepare.h check every field, and prepare.h reads shared memory once. The description owns nothing; the memory
 * that it points to must live until prepare() returns.
 */
#ifndef BVHD_GEOMETRY_H
#define BVHD_GEOMETRY_H

#include <stdint.h>

#include "proto/base/box.h"
#include "proto/base/bytes.h"
#include "proto/base/device_format.h"
#include "proto/base/key.h"
#include "proto/base/slabs.h"

/* VkAccelerationStructureTypeKHR */
enum {
    STRUCTURE_TOP = 0,
    STRUCTURE_BOTTOM = 1,
    STRUCTURE_GENERIC = 2,
    STRUCTURE_MICROMAP = 1000623000, /* Vulkan: OPACITY_MICROMAP_KHR; micromaps of VK_EXT_opacity_micromap, too */
};

/*
 * VkGeometryTypeKHR, and types of bvhd's own: of geometry that moves, which Vulkan says elsewhere, and of micromaps
 * that are made from a texture
 */
enum {
    GEOMETRY_TRIANGLES = 0,
    GEOMETRY_AABBS = 1,
    GEOMETRY_INSTANCES = 2,
    GEOMETRY_SPHERES = 1000429004,
    GEOMETRY_SWEPT_SPHERES = 1000429005, /* Vulkan: LINEAR_SWEPT_SPHERES_NV */
    GEOMETRY_MICROMAP = 1000623000, /* the only geometry of a micromap */
    GEOMETRY_MOVING_TRIANGLES = 0x40000000, /* TRIANGLES with VkAccelerationStructureGeometryMotionTrianglesDataNV */
    GEOMETRY_MOVING_INSTANCES = 0x40000002, /* INSTANCES of a build with BUILD_MOTION */
    GEOMETRY_BAKED_MICROMAP = 0x40000003, /* the only geometry of a micromap whose states a texture decides */
};

/* VkAccelerationStructureMotionInstanceTypeNV */
enum { MOTION_STATIC = 0, MOTION_MATRIX = 1, MOTION_SRT = 2, MOTION_TYPES = 3 };

/*
 * A VkAccelerationStructureMotionInstanceNV: its type (MOTION_), its flags, which are 0, and at MOTION_RECORD_DATA an
 * instance of that type. In arrays, records are MOTION_RECORD_STRIDE bytes apart.
 */
enum { MOTION_RECORD_DATA = 8, MOTION_RECORD_SIZE = 152, MOTION_RECORD_STRIDE = 160 };

/* VkGeometryFlagBitsKHR */
enum { GEOMETRY_OPAQUE = 1, GEOMETRY_NO_DUPLICATE_ANY_HIT = 2 };

/* VkIndexType */
enum { INDEX_UINT16 = 0, INDEX_UINT32 = 1, INDEX_NONE = 1000165000, INDEX_UINT8 = 1000265000 };

/* VkRayTracingLssIndexingModeNV */
enum { SWEPT_LIST = 0, SWEPT_SUCCESSIVE = 1 };

/* VkRayTracingLssPrimitiveEndCapsModeNV */
enum { SWEPT_CAPS_NONE = 0, SWEPT_CAPS_CHAINED = 1 };

/* VkBuildAccelerationStructureModeKHR */
enum { MODE_BUILD = 0, MODE_UPDATE = 1 };

/* VkBuildAccelerationStructureFlagBitsKHR */
enum {
    BUILD_ALLOW_UPDATE = 0x1,
    BUILD_ALLOW_COMPACTION = 0x2,
    BUILD_PREFER_FAST_TRACE = 0x4,
    BUILD_PREFER_FAST_BUILD = 0x8,
    BUILD_LOW_MEMORY = 0x10,
    BUILD_MOTION = 0x20,
    BUILD_ALLOW_MICROMAP_UPDATE = 0x40, /* this and the next: of OPACITY_MICROMAP(S) */
    BUILD_ALLOW_DISABLE_MICROMAPS = 0x80,
    BUILD_ALLOW_MICROMAP_DATA_UPDATE = 0x100,
    BUILD_MICROMAP_LOSSY = 0x400,
    BUILD_ALLOW_DATA_ACCESS = 0x800,
};

/* VkGeometryInstanceFlagBitsKHR */
enum {
    INSTANCE_CULL_DISABLE = 0x1,
    INSTANCE_FLIP_FACING = 0x2,
    INSTANCE_FORCE_OPAQUE = 0x4,
    INSTANCE_FORCE_NO_OPAQUE = 0x8,
    INSTANCE_FORCE_MICROMAP_2_STATE = 0x10,
    INSTANCE_DISABLE_MICROMAPS = 0x20,
};

/*
 * VkOpacityMicromapSpecialIndexEXT, as the 32-bit number that it is after an index of any width has been read: the
 * whole triangle has state ~index of enum micro_state.
 */
#define MICROMAP_FULLY_TRANSPARENT UINT32_C(0xffffffff)
#define MICROMAP_FULLY_OPAQUE UINT32_C(0xfffffffe)
#define MICROMAP_FULLY_UNKNOWN_TRANSPARENT UINT32_C(0xfffffffd)
#define MICROMAP_FULLY_UNKNOWN_OPAQUE UINT32_C(0xfffffffc)

/* VkAccelerationStructureBuildRangeInfoKHR */
struct geometry_range {
    uint32_t primitive_count;
    uint32_t primitive_offset; /* bytes */
    uint32_t first_vertex;
    uint32_t transform_offset; /* bytes */
};

/* VkMicromapUsageEXT: how many triangles of a micromap, or with one, have this level and format. */
struct micromap_usage {
    uint32_t count;
    uint32_t level; /* subdivisionLevel, 0 .. 12 */
    uint32_t format; /* VkOpacityMicromapFormatEXT: enum micro_format */
};

/* VkMicromapTriangleEXT: where the states of a micromap's triangle begin, in bytes, and what they are. */
struct micromap_triangle {
    uint32_t offset;
    uint16_t level;
    uint16_t format;
};

_Static_assert(sizeof(struct micromap_usage) == 12 && sizeof(struct micromap_triangle) == 8, "Vulkan's structs");

/*
 * VkAccelerationStructureGeometryMicromapDataKHR, or the same part of VkMicromapBuildInfoEXT. range.primitive_count is
 * the number of triangles, the sum of the counts of `usages`.
 */
struct geometry_micromap {
    struct bytes usages; /* of struct micromap_usage, at any alignment */
    struct bytes states; /* data: what the offsets of triangles count in */
    struct bytes triangles; /* of struct micromap_triangle */
    uint64_t stride; /* of `triangles`, in bytes */
};

/* How a texture is repeated outside of [0, 1). */
enum bake_wrap { BAKE_REPEAT = 0, BAKE_MIRRORED_REPEAT = 1, BAKE_CLAMP_TO_EDGE = 2 };

/* What alpha decides. */
enum bake_mode {
    BAKE_MASK = 0, /* alpha at or over the cutoff is opaque, other is transparent (glTF's MASK) */
    BAKE_BLEND = 1, /* alpha 255 is opaque, alpha 0 transparent, and all between unknown (glTF's BLEND) */
};

/* The level of a bake that chooses each triangle's level by how much it decides for its bytes. */
#define BAKE_LEVEL_AUTO UINT32_C(0xffffffff)

/*
 * A micromap that is made from the alpha of a texture: one of its indices for each of range.primitive_count triangles,
 * which texture coordinates place on the texture. It has no counterpart in Vulkan.
 */
struct geometry_bake {
    struct bytes alpha; /* rows of one byte a texel */
    uint32_t width, height; /* texels, 1 .. 16,384 */
    uint64_t row_stride; /* bytes */
    uint32_t wrap_u, wrap_v; /* enum bake_wrap */
    uint32_t is_nearest; /* 1: the nearest texel decides; 0: alpha is interpolated between four texels */
    uint32_t mode; /* enum bake_mode */
    float cutoff; /* of BAKE_MASK: 0 .. 1 */
    uint32_t format; /* enum micro_format */
    uint32_t level; /* the most of a triangle: 0 .. 12, or BAKE_LEVEL_AUTO */
    struct bytes coordinates; /* two floats a vertex */
    uint64_t coordinate_stride; /* bytes */
    uint32_t vertex_count;
    uint32_t index_type; /* INDEX_: UINT16, UINT32, NONE */
    struct bytes indices; /* three a triangle; ignored if index_type is INDEX_NONE */
};

/*
 * VkAccelerationStructureTrianglesOpacityMicromapEXT or ...KHR: the micromap of each triangle of a geometry. Triangle i
 * has the index that is read at indices + i * stride, or i itself without indices. A special index (MICROMAP_FULLY_)
 * stands for one state; to others base_triangle is added, and the sum names a triangle of the micromap.
 */
struct triangle_micromap {
    uint32_t is_given; /* 1: the struct is there; 0: the geometry has no micromap, and all else is 0 */
    uint32_t index_type; /* INDEX_: UINT16, UINT32, NONE; of the KHR struct also INDEX_UINT8 */
    struct bytes indices; /* ignored if index_type is INDEX_NONE */
    uint64_t stride; /* of `indices`, in bytes; 0 is legal */
    uint32_t base_triangle;
    uint32_t has_usages; /* 1: `usages` are given (EXT); 0: they are not (KHR) */
    struct bytes usages; /* of struct micromap_usage: those of the triangles that are named, special ones excluded */
    uint64_t micromap; /* the handle of a reference of REFERENCE_MICROMAP; 0: none, so that all indices are special */
};

/* VkAccelerationStructureGeometryTrianglesDataKHR */
struct geometry_triangles {
    uint32_t vertex_format; /* VkFormat */
    uint32_t max_vertex;
    uint64_t vertex_stride; /* bytes; 0 is legal */
    uint32_t index_type;
    struct bytes vertices;
    struct bytes indices; /* ignored if index_type is INDEX_NONE */
    struct bytes transform; /* a row-major 3x4 float matrix at range.transform_offset; data NULL: no transform */
    /* GEOMETRY_MOVING_TRIANGLES: the vertices at t = 1, while `vertices` has those at t = 0; both move in lines */
    struct bytes end_vertices;
    struct triangle_micromap micromap; /* of both kinds of triangles */
};

/* VkAccelerationStructureGeometryAabbsDataKHR: six floats per box, minimum then maximum */
struct geometry_aabbs {
    uint64_t stride; /* bytes; a multiple of 8; 0 is legal */
    struct bytes boxes;
};

/*
 * VkAccelerationStructureGeometrySpheresDataNV: a centre and a radius for each vertex. range.primitive_offset applies
 * to the indices or, without indices, to both the centres and the radii.
 */
struct geometry_spheres {
    uint32_t vertex_format, radius_format; /* VkFormat */
    uint32_t index_type;
    uint64_t vertex_stride, radius_stride, index_stride; /* bytes; 0 is legal */
    struct bytes vertices;
    struct bytes radii;
    struct bytes indices; /* ignored if index_type is INDEX_NONE */
};

/*
 * VkAccelerationStructureGeometryLinearSweptSpheresDataNV: each primitive is what a sphere sweeps that moves from one
 * vertex to another, while its radius changes in proportion to its way.
 */
struct geometry_swept_spheres {
    struct geometry_spheres ends;
    uint32_t indexing_mode; /* SWEPT_ */
    uint32_t end_caps_mode; /* SWEPT_CAPS_ */
};

/*
 * VkAccelerationStructureGeometryInstancesDataKHR: an array of 64-byte records, of GEOMETRY_MOVING_INSTANCES of motion
 * records. Arrays of pointers are gathered into records before.
 */
struct geometry_instances {
    struct bytes records;
};

/* One geometry: VkAccelerationStructureGeometryKHR with its range. */
struct geometry {
    uint32_t type; /* GEOMETRY_ */
    uint32_t flags; /* GEOMETRY_OPAQUE | GEOMETRY_NO_DUPLICATE_ANY_HIT */
    union {
        struct geometry_triangles triangles;
        struct geometry_aabbs aabbs;
        struct geometry_instances instances;
        struct geometry_spheres spheres;
        struct geometry_swept_spheres swept_spheres;
        struct geometry_micromap micromap;
        struct geometry_bake bake;
    };
    struct geometry_range range;
};

/* A structure that others may reference: a bottom level under a top level, or a micromap on triangles. */
enum reference_kind { REFERENCE_BLAS = 1, REFERENCE_MICROMAP = 2 };

struct reference {
    enum reference_kind kind;
    uint64_t handle; /* the value that instance records or triangles carry; not 0; unique within the table */
    bool moves; /* it has motion triangles, so only a top level with BUILD_MOTION may name it */
    bool may_disable_micromaps; /* built with ALLOW_DISABLE_MICROMAPS, which INSTANCE_DISABLE_MICROMAPS needs */
    bool has_key;
    struct key key; /* if has_key: the key of the structure's bytes */
    struct box bounds; /* of the structure in its own space; box_empty() for an empty structure */
    struct slabs slabs; /* of the structure in its own space; may be unknown */
    /*
     * REFERENCE_MICROMAP, which has a key, and neither bounds nor slabs: the micromap's bytes, as a target's writer
     * made them. They do not travel: whoever prepares the build has found them by the key.
     */
    struct bytes blob;
};

/* How much time a build may take to make tracing faster; requests choose it in addition to Vulkan's flags. */
enum build_quality {
    QUALITY_UNSPECIFIED = 0, /* Vulkan's PREFER flags decide; without them the same as auto */
    QUALITY_FAST = 1,
    QUALITY_BALANCED = 2,
    QUALITY_HIGH = 3,
    QUALITY_AUTO = 4,
};

/* Whose methods build the trees: bvhd's own, or those of Embree, which a daemon may lack. */
enum build_builder { BUILDER_OWN = 0, BUILDER_EMBREE = 1 };

/* The formats in which structures can be written. */
enum target {
    TARGET_PORTABLE = 1,
    TARGET_LAVAPIPE = 2, /* the native format of Mesa's CPU driver */
};

/* Options of the portable layout. */
enum { PORTABLE_FAST_TRIANGLES = 0x1 }; /* three float4 per triangle instead of shared, indexed vertices */

/* The choices of a request for which Vulkan's structs have no member. */
struct build_options {
    enum build_quality quality;
    enum target target;
    uint32_t layout_flags; /* PORTABLE_FAST_TRIANGLES */
    struct device_format device; /* for a native target; portable: all zero */
    /*
     * how many rays per primitive will be traced through the result, if the caller knows; 0: unknown. QUALITY_AUTO uses
     * it.
     */
    float rays_per_primitive;
    enum build_builder builder;
};

/* One entry of a batch. */
struct build_input {
    uint32_t type; /* STRUCTURE_ */
    uint32_t flags; /* BUILD_ */
    uint32_t mode; /* MODE_ */
    uint64_t destination; /* the caller's handle of the structure to build, 0 for none: only compared within a batch */
    uint64_t source; /* the same for the source of MODE_UPDATE */
    struct key source_key; /* of MODE_UPDATE: the source's key, by which it is found; all 0: not given */
    uint32_t geometry_count;
    const struct geometry *geometries;
    uint32_t reference_count;
    const struct reference *references;
    struct build_options options;
};

#endif
