/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse.h - rays through portable structures, on the CPU. The reference for shaders, and what `bvhctl check` and
 * `trace` run.
 *
 * Vulkan's semantics (row F62): triangles are hit for tmin < t < tmax, AABB candidates are reported for intersections
 * of the closed interval. Boxes are tested conservatively (boxtest.h), in float, or in double for rays or structures
 * with magnitudes outside 2^-60 .. 2^60. Triangles are decided in double with exact signs (triangle.h): no ray slips
 * between triangles that share an edge or a vertex, none hits twice there. Answers do not depend on the order of
 * visits: of equal t, to 32 significant bits, the lowest (instance, geometry, primitive) wins. With
 * TERMINATE_ON_FIRST_HIT, whether there is a hit does not depend on it, which one it is does. An instance's ray is
 * transformed in double; t is the same in both spaces, facing is that of object space.
 */
#ifndef BVHD_TRAVERSE_H
#define BVHD_TRAVERSE_H

#include "builder/format/portable.h"

/*
 * VkRayFlags as in SPIR-V. Opaque and NoOpaque exclude each other, likewise the three of culling by facing and skipping
 * triangles.
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

struct ray {
    float origin[3];
    float tmin;
    /* need not be of unit length; zero, or an origin or direction that is not finite, hits nothing */
    float direction[3];
    float tmax; /* may be infinite; hits nothing unless tmin <= tmax */
    uint32_t flags;
    uint8_t cull_mask; /* instances with mask & cull_mask == 0 are not there */
};

struct ray_hit {
    float t; /* t, u, v are computed in double and rounded once */
    float u, v; /* barycentrics: position = (1-u-v) v0 + u v1 + v v2; 0 for AABBs */
    uint32_t instance; /* position in the TLAS request; RAY_NO_INSTANCE without a TLAS */
    uint32_t custom_index; /* 24 bits */
    uint32_t sbt_offset; /* 24 bits */
    uint32_t geometry; /* index in its BLAS */
    uint32_t primitive; /* index in its geometry */
    uint32_t record; /* row in the BLAS's records: positions are fetched there */
    uint32_t handle; /* row of the scene's bottoms that was hit; 0 without a TLAS */
    bool front_face;
    bool is_aabb;
};

/*
 * What traversal runs over: one bottom level, or a top level with one view for each handle of it (NULL view: as if
 * inactive).
 */
struct scene {
    const struct portable_view *top; /* NULL: bottoms[0] alone */
    const struct portable_view *const *bottoms;
    uint32_t bottom_count;
};

/* What a candidate is taken for. */
enum candidate_verdict { CANDIDATE_IGNORE, CANDIDATE_ACCEPT, CANDIDATE_ACCEPT_AND_END };

/*
 * Called for each non-opaque triangle and each AABB candidate that could still be the answer. For AABBs, hit->t comes
 * in as the entry distance clamped to the ray's interval and the callee sets it when it accepts. May be called in any
 * order and, with split references, more than once for a primitive unless its geometry says NO_DUPLICATE_ANY_HIT.
 */
typedef enum candidate_verdict (*candidate_function)(void *context, const struct ray *ray, struct ray_hit *hit);

struct traverse_options {
    candidate_function candidate; /* NULL: triangles are accepted, AABBs are accepted at their entry distance */
    void *context;
    bool flip_order; /* visit children in the opposite order; answers are the same */
    bool baseline_only; /* use no instructions beyond the baseline; answers are the same */
    bool exact_only; /* test all boxes in double; answers are the same */
};

/* What it cost; added to, not reset. */
struct traverse_counters {
    uint64_t nodes, triangles, instances;
};

/*
 * Closest hit (or any hit, with RAY_TERMINATE_ON_FIRST_HIT). True and *ret_hit on a hit. `options` and `counters` may
 * be NULL.
 */
bool traverse(const struct scene *scene, const struct ray *ray, const struct traverse_options *options,
              struct ray_hit *ret_hit, struct traverse_counters *counters);

/* Position fetch: object-space corners of the triangle that was hit, exactly as stored. Not for AABBs. */
void traverse_positions(const struct scene *scene, const struct ray_hit *hit, float ret_corners[3][3]);

#endif
