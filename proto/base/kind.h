/* SPDX-License-Identifier: Apache-2.0 */
/*
 * kind.h - what distinguishes the kinds of geometry: one struct for each kind, so that code for all kinds need not ask
 * for single ones. Each folder that treats kinds differently has a table of its own. Tables about requests are indexed
 * by enum kind_number, tables about portable structures (record_kind.h, leaf_kind.h) by their content.
 *
 * All functions may be called from any thread.
 */
#ifndef BVHD_KIND_H
#define BVHD_KIND_H

#include "proto/base/geometry.h"
#include "proto/base/status.h"

struct validate_subject;

/* The kinds of geometry, numbered without gaps, which Vulkan's numbers are not. */
enum kind_number {
    KIND_TRIANGLES,
    KIND_AABBS,
    KIND_INSTANCES,
    KIND_SPHERES,
    KIND_SWEPT_SPHERES,
    KIND_MOVING_TRIANGLES,
    KIND_MOVING_INSTANCES,
    KIND_MICROMAP,
    KIND_BAKED_MICROMAP,
    KIND_COUNT,
    KIND_OF_RAYS = KIND_MICROMAP /* those before it are of primitives, which rays hit and of which trees are built */
};

struct kind {
    uint32_t type; /* GEOMETRY_ */
    uint32_t vulkan_type; /* VkGeometryTypeKHR: kinds that move have that of those that do not */
    bool moves; /* the geometry has one place at t = 0 and another at t = 1 */
    enum kind_number number;
    const char *noun; /* in texts: "AABBs" */
    const char *member; /* in places, as in "infos[0].geometries[1].aabbs.stride": "aabbs" */
    bool is_top; /* top levels are made of it and of nothing else; bottom levels never are */
    bool is_micromap; /* it is the only geometry of a STRUCTURE_MICROMAP; its primitives are triangles of a micromap */
    /*
     * The rule that more primitives than the limit break. BVHD_VUID_NONE: Vulkan counts this kind against no limit, and
     * bvhd's own is BVHD_TOO_LARGE.
     */
    enum bvhd_vuid too_many;
    bool can_be_cut; /* spatial splits cut such primitives (clip.h) */
    uint32_t primitive_bytes; /* of a primitive in a canonical copy: its indices, its box or its record */
    /* of a vertex in a canonical copy; 0: the kind has no vertices. The states of micromaps count as vertices. */
    uint32_t vertex_bytes;

    /*
     * Checks formats, strides and index type of a geometry of this kind. It returns BVHD_INVALID with the rule and the
     * place.
     */
    enum bvhd_status (*check_shape)(const struct validate_subject *subject);

    /* Returns how many vertices a canonical copy of the geometry has at the most. The geometry need not be valid. */
    uint64_t (*vertices)(const struct geometry *geometry);
};

/* Returns the kind of this GEOMETRY_ type, or NULL for a type of which bvhd builds nothing. */
const struct kind *kind_find(uint32_t type);

/*
 * Returns the kind with this VkGeometryTypeKHR that moves, or the one that does not; NULL if there is none. bvhd's own
 * types are none of Vulkan's.
 */
const struct kind *kind_find_vulkan(uint32_t vulkan_type, bool moves);

#endif
