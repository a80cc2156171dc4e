/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_micromap.h - opacity micromaps: from Vulkan's structs of VK_EXT_opacity_micromap, and from textures.
 *
 * An opacity micromap cuts triangles into micro-triangles, 4^level each, and says of each one whether it is opaque,
 * transparent or unknown. Rays then pass through what is transparent, and hit what is opaque, without a test by the
 * program. A micromap is built like a structure and is a result of a batch like others: it has a key, it is cached,
 * coalesced and cancelled, and bvhd_batch_fetch finds it again. A bottom level names it by a handle that a reference
 * with its key has:
 *
 *     struct bvhd_micromap_build build = {.struct_size = sizeof build, .info_count = 1, .infos = &info};
 *     bvhd_micromap_submit(client, &build, &batch, &error);
 *     bvhd_batch_wait(batch, -1);
 *     const struct bvhd_result *result = bvhd_batch_result(batch, 0);
 *     struct bvhd_reference reference = {.handle = 7, .has_key = 1, .key = result->key};
 *     VkAccelerationStructureTrianglesOpacityMicromapEXT attached = {...; .micromap = (VkMicromapEXT)7};
 *     triangles.pNext = &attached;
 *
 * The bottom level is then requested by bvhd_batch_submit, with `reference` among the references of its bvhd_build.
 *
 * This version refuses all micromaps with BVHD_UNSUPPORTED, as the results of their requests: they are not traced yet.
 *
 * There are three ways to describe a micromap:
 *
 *   states   VkMicromapBuildInfoEXT, for bvhd_micromap_submit;
 *   states   VkAccelerationStructureGeometryMicromapDataKHR (<bvhd/vulkan_khr.h>) in the chain of the only geometry, of
 *            the type VK_GEOMETRY_TYPE_MICROMAP_KHR, of a structure of the type
 *            VK_ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR, for bvhd_batch_submit, whose ranges it does not need;
 *   texture  bvhd_micromap_bake: in that chain, too, or for bvhd_micromap_submit.
 *
 * Equal states in the first two give the same bytes and the same key. Levels go up to 12. Micromaps are of the portable
 * target. Addresses are the host's, and the memory behind them is read as that of geometry is: it must stay readable
 * and unchanged until bvhd_batch_is_copied. Everything else is copied before a call returns.
 *
 * The Vulkan headers must have VK_EXT_opacity_micromap (version 1.3.230). Threads and errors are those of bvhd.h.
 */
#ifndef BVHD_BVHD_MICROMAP_H
#define BVHD_BVHD_MICROMAP_H

#include <bvhd/bvhd.h>
#include <bvhd/vulkan_khr.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Micromaps that are made from textures ---- */

/* sType of struct bvhd_micromap_bake. It is none of Vulkan's. */
#define BVHD_STRUCTURE_TYPE_MICROMAP_BAKE ((VkStructureType)0x40000003)

/* How a texture is repeated outside of [0, 1). */
enum bvhd_bake_wrap { BVHD_BAKE_REPEAT = 0, BVHD_BAKE_MIRRORED_REPEAT = 1, BVHD_BAKE_CLAMP_TO_EDGE = 2 };

/* Which alpha is opaque. */
enum bvhd_bake_mode {
    BVHD_BAKE_MASK = 0, /* alpha at or over the cutoff; other is transparent */
    BVHD_BAKE_BLEND = 1, /* 255; 0 is transparent, and all between is unknown */
};

/* bvhd_micromap_bake.level: the level of each triangle is chosen by how much it decides for its bytes */
#define BVHD_BAKE_LEVEL_AUTO UINT32_C(0xffffffff)

/*
 * The alpha of a texture, and the triangles that lie on it. With four states, a micro-triangle is opaque or transparent
 * where that is certain: where a lookup of the texture, without mip maps, says so at each of its points. Others are
 * unknown, with the state of their middle. With two states, each micro-triangle has the state of its middle. Triangles
 * whose states are equal share them; a triangle in one state throughout has a special index and no states. Therefore
 * the micromap comes with an index for each triangle.
 */
struct bvhd_micromap_bake {
    VkStructureType sType; /* BVHD_STRUCTURE_TYPE_MICROMAP_BAKE */
    const void *pNext; /* NULL, or the rest of a chain; bvhd_micromap_submit takes NULL only */
    const uint8_t *alpha; /* rows of one byte a texel, the first row at v = 0 */
    uint32_t width, height; /* texels: 1 .. 16,384 */
    uint64_t row_stride; /* bytes from one row to the next: at least width */
    enum bvhd_bake_wrap wrap_u, wrap_v;
    VkBool32 is_nearest; /* VK_TRUE: the nearest texel decides; VK_FALSE: alpha is interpolated between four texels */
    enum bvhd_bake_mode mode;
    float cutoff; /* of BVHD_BAKE_MASK: 0 .. 1, where 1 stands for alpha 255; else ignored */
    VkOpacityMicromapFormatKHR format;
    uint32_t level; /* the most of a triangle: 0 .. 12, or BVHD_BAKE_LEVEL_AUTO */
    const void *coordinates; /* two floats a vertex: u, v */
    uint64_t coordinate_stride; /* bytes from one vertex to the next: a multiple of 4 */
    uint32_t vertex_count;
    uint32_t triangle_count;
    VkIndexType index_type; /* UINT16 or UINT32, of three indices a triangle; NONE: three vertices a triangle */
    const void *indices; /* with NONE ignored */
};

/* ---- Requests ---- */

/* A request for several micromaps. */
struct bvhd_micromap_build {
    size_t struct_size; /* sizeof(struct bvhd_micromap_build) */
    uint32_t info_count; /* number of micromaps to build; may be 0 */
    uint32_t deadline_ms; /* as in bvhd_build */
    /*
     * One of these is an array, the other NULL. Of `infos`, dstMicromap and scratchData are ignored.
     */
    const VkMicromapBuildInfoEXT *infos;
    const struct bvhd_micromap_bake *bakes;
    enum bvhd_priority priority;
    uint32_t reserved; /* 0 */
};

/*
 * Requests micromaps, and returns without waiting for them. Item i of the batch is infos[i] or bakes[i]. An info that
 * breaks a rule has that error as its result; what is wrong with its data has the place that it has in the structs of
 * VK_KHR_opacity_micromap, as "infos[3].geometries[0].micromap.triangleArrayStride", or with ".bake" instead of
 * ".micromap". The call itself fails with BVHD_INVALID if the struct bvhd_micromap_build is wrong, or sType or pNext of
 * one of its bakes, and otherwise as bvhd_batch_submit does. The caller destroys the batch with bvhd_batch_destroy.
 */
BVHD_API enum bvhd_status bvhd_micromap_submit(struct bvhd_client *client, const struct bvhd_micromap_build *build,
                                               struct bvhd_batch **ret_batch, struct bvhd_error *ret_error);

/* ---- What a micromap has ---- */

enum { BVHD_MICROMAP_MAX_USAGES = 26 /* 13 levels in 2 formats */, BVHD_MICROMAP_STATES = 4 };

/* The contents of a micromap. */
struct bvhd_micromap {
    size_t struct_size; /* sizeof(struct bvhd_micromap), which the caller sets; all else is set by the call */
    uint32_t triangle_count; /* triangles with states of their own; indices are below */
    /* Of a baked one: an index, or a special one, for each triangle of the request. 0 and NULL for others. */
    uint32_t index_count;
    const uint32_t *indices; /* leads into the micromap's bytes: for indexBuffer, with the index type UINT32 */
    uint64_t states_size; /* bytes */
    /*
     * Of a baked one: the micro-triangles of all triangles of the request that are transparent, opaque, unknown but
     * transparent, and unknown but opaque. Only the last two need a test. 0 for others.
     */
    uint64_t baked[BVHD_MICROMAP_STATES];
    uint32_t usage_count, named_usage_count;
    VkMicromapUsageEXT usages[BVHD_MICROMAP_MAX_USAGES]; /* of the triangles: as in pUsageCounts of a build */
    /* of those that the indices name: pUsageCounts of the struct that attaches the micromap with all of its indices */
    VkMicromapUsageEXT named_usages[BVHD_MICROMAP_MAX_USAGES];
};

/*
 * Reads the bytes of a micromap, a result's data and size, which may come from an untrusted source. They are aligned to
 * 16 bytes and must outlive the use of `indices`. Takes time in proportion to the number of triangles. Returns
 * BVHD_CORRUPT or BVHD_INCOMPATIBLE for bytes that are no micromap of this version, and BVHD_INVALID for a wrong
 * argument.
 */
BVHD_API enum bvhd_status bvhd_micromap_read(const void *data, uint64_t size, struct bvhd_micromap *ret_micromap,
                                             struct bvhd_error *ret_error);

#ifdef __cplusplus
}
#endif

#endif
