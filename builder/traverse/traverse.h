/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse.h - traces rays through portable structures on the CPU. It is the reference for shaders, and `bvhctl check`
 * and `trace` use it.
 *
 * The semantics are Vulkan's (Vulkan specification, Ray Traversal). Triangles are hit for tmin < t < tmax; AABB
 * candidates are reported if the ray meets them in the closed interval. Boxes are tested conservatively (boxtest.h), in
 * float, or in double for rays or structures with magnitudes outside 2^-60 .. 2^60. Triangles are decided in double
 * with exact signs (triangle.h), which is watertight: no ray slips between triangles that share an edge or a vertex,
 * and none hits twice there.
 *
 * Answers do not depend on the order of visits: of hits with equal t, to 32 significant bits, the one with the lowest
 * (instance, geometry, primitive) wins. With TERMINATE_ON_FIRST_HIT only the existence of a hit is independent of the
 * order, not which hit it is. An instance's ray is transformed in double; t is the same in both spaces, and facing is
 * decided in object space.
 */
#ifndef BVHD_TRAVERSE_H
#define BVHD_TRAVERSE_H

#include "builder/format/portable.h"

/*
 * VkRayFlags as in SPIR-V. Opaque and NoOpaque exclude each other, as do the two flags of culling by facing and
 * SKIP_TRIANGLES.
 */
enum {
    RAY_OPAQUE = 0x1,
    RAY_NO_OPAQUE = 0x2,
    RAY_TERMINATE_ON_FIRST_HIT = 0x4,
    RAY_CULL_BACK_FACING = 0x10,
    RAY_CULL_FRONT_FACING = 0x20,
    RAY_CULL_OPAQUE = 0x40,
    RAY_CULL_NO_OPAQUE = 0x80,
    RAY_SKIP_TRIANGLES = 0x100,
    RAY_SKIP_AABBS = 0x200,
};

#define RAY_NO_INSTANCE UINT32_C(0xffffffff)

/* A ray in world space, with Vulkan's ray flags. */
struct ray {
    float origin[3];
    float tmin;
    /*
     * Need not be of unit length. A ray with a direction of zero, or with an origin or a direction that is not finite,
     * hits nothing.
     */
    float direction[3];
    float tmax; /* may be infinite; the ray hits nothing unless tmin <= tmax */
    uint32_t flags;
    uint8_t cull_mask; /* instances with mask & cull_mask == 0 are invisible */
};

/* A hit. */
struct ray_hit {
    float t; /* t, u, v are computed in double and rounded once */
    float u, v; /* barycentrics: position = (1-u-v) v0 + u v1 + v v2; 0 for AABBs */
    uint32_t instance; /* position in the TLAS request; RAY_NO_INSTANCE if there is no TLAS */
    uint32_t custom_index; /* 24 bits */
    uint32_t sbt_offset; /* 24 bits */
    uint32_t geometry; /* index in its BLAS */
    uint32_t primitive; /* index in its geometry */
    uint32_t record; /* row in the BLAS's records, from which positions are fetched */
    uint32_t handle; /* row of the scene's bottoms that was hit; 0 if there is no TLAS */
    bool front_face;
    bool is_aabb;
};

/*
 * The scene to trace: one bottom level, or a top level with one view for each of its handles (NULL: the instance counts
 * as inactive).
 */
struct scene {
    const struct portable_view *top; /* NULL: the scene is bottoms[0] alone */
    const struct portable_view *const *bottoms;
    uint32_t bottom_count;
};

/* The any-hit decision about a candidate. */
enum candidate_verdict { CANDIDATE_IGNORE, CANDIDATE_ACCEPT, CANDIDATE_ACCEPT_AND_END };

/*
 * The any-hit callback: called for each non-opaque triangle and each AABB candidate that can still be the answer. For
 * an AABB, hit->t holds the entry distance clamped to the ray's interval, and the callback sets it if it accepts. Calls
 * come in any order and, with split references, possibly more than once for a primitive unless its geometry has
 * NO_DUPLICATE_ANY_HIT.
 */
typedef enum candidate_verdict (*candidate_function)(void *context, const struct ray *ray, struct ray_hit *hit);

/* How to trace. All zero is the default. */
struct traverse_options {
    candidate_function candidate; /* NULL: triangles are accepted, and AABBs at their entry distance */
    void *context;
    bool flip_order; /* visit children in the opposite order; the answers are the same */
    bool baseline_only; /* use no instructions beyond the baseline; the answers are the same */
    bool exact_only; /* test all boxes in double; the answers are the same */
};

/* The work that was done. Counts are added to, not reset. */
struct traverse_counters {
    uint64_t nodes, triangles, instances;
};

/*
 * Finds the closest hit (or any hit, with RAY_TERMINATE_ON_FIRST_HIT). Returns true and fills *ret_hit if there is one,
 * otherwise returns false and leaves *ret_hit as it was. `options` and `counters` may be NULL. May be called from any
 * thread.
 */
bool traverse(const struct scene *scene, const struct ray *ray, const struct traverse_options *options,
              struct ray_hit *ret_hit, struct traverse_counters *counters);

/* Fetches the object-space corners of the triangle that was hit, exactly as stored. Not for AABBs. */
void traverse_positions(const struct scene *scene, const struct ray_hit *hit, float ret_corners[3][3]);

#endif
