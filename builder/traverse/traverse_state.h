/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_state.h - the state of one ray for every layout: the semantics of traverse.h, implemented once. Internal.
 *
 * A layout's traversal provides the walk over its nodes and the reading of its leaves. For each bottom level that the
 * ray reaches it calls traverse_state_enter (before that, traverse_state_to_object if the bottom level belongs to an
 * instance). Then it passes the primitives of each leaf that the ray may meet at a distance of at most the state's tmax
 * to traverse_leaf_triangle, traverse_leaf_hit, traverse_leaf_round or traverse_leaf_aabb, until is_done is set.
 */
#ifndef BVHD_TRAVERSE_STATE_H
#define BVHD_TRAVERSE_STATE_H

#include "builder/traverse/boxtest.h"
#include "builder/traverse/round_ray.h"
#include "builder/traverse/traverse.h"
#include "builder/traverse/triangle.h"

/* The instance through which a bottom level is reached. */
struct traverse_instance {
    uint32_t custom_and_mask, sbt_and_flags; /* as in Vulkan's record */
    uint32_t instance; /* position in the request; RAY_NO_INSTANCE if there is no top level */
    uint32_t bottom; /* row of the scene's bottoms */
    uint32_t record; /* row of the top level's records */
};

/* The kind of primitive that a ray has met. */
enum traverse_kind { MET_TRIANGLE, MET_AABB, MET_SPHERE, MET_SWEPT_SPHERE };

/* A hit, or a candidate. */
struct traverse_found {
    double t, u, v;
    /* the primitive in its bottom level, in the layout's terms; ordered by (geometry, primitive) */
    uint64_t id;
    uint32_t record;
    bool is_opaque; /* its geometry is opaque */
    bool front_face;
    uint8_t kind; /* MET_ */
    bool is_closed; /* it counts at both ends of the ray's interval; triangles do not */
};

/* Whether primitives count as opaque. */
enum traverse_opacity { OPACITY_AS_BUILT, OPACITY_OPAQUE, OPACITY_NO_OPAQUE };

/* One ray: its answer so far, and the bottom level in which it is. */
struct traverse_state {
    const struct ray *ray;
    const struct traverse_options *options; /* never NULL */
    struct traverse_counters counters;

    /* Provided by the layout: finds the primitive of an id. */
    void (*identify)(const struct traverse_state *state, uint32_t bottom, uint64_t id, uint32_t *ret_geometry,
                     uint32_t *ret_primitive);

    /* The end of the interval in which a hit can still be the answer: the closest hit so far, or the ray's tmax. */
    double tmax;
    float tmax_above; /* rounded up */
    bool is_hit, is_done;
    struct traverse_found best;
    struct traverse_instance best_instance;

    /* The bottom level that is being traversed, and the ray in its space. */
    struct traverse_instance instance;
    bool cull_front, cull_back, is_flipped;
    bool is_plain; /* no triangle is culled, and there is no any-hit callback */
    enum traverse_opacity opacity;
    const float *object_to_world; /* of the instance; NULL if there is no top level */
    double origin[3], direction[3];
    struct triangle_ray triangle_ray; /* if its primitives are triangles */
    struct round_ray round_ray; /* if they are spheres or linear swept spheres */
    enum traverse_kind round_kind; /* which of these they are */
};

/* Starts a ray, which is in no space yet. Returns false if its interval is empty, so that nothing is hit. */
static inline bool traverse_state_begin(struct traverse_state *state, const struct ray *ray,
                                        const struct traverse_options *options)
{
    /* The fields are set one by one, because clearing the whole struct costs more than a short traversal. */
    static const struct traverse_options defaults = {0};
    state->ray = ray;
    state->options = options ? options : &defaults;
    state->counters = (struct traverse_counters){0, 0, 0};
    state->tmax = ray->tmax;
    state->tmax_above = ray->tmax;
    state->is_hit = state->is_done = false;
    state->object_to_world = NULL;
    return ray->tmin <= ray->tmax;
}

/* Puts the ray into world space. */
static inline void traverse_state_to_world(struct traverse_state *state)
{
    for (int axis = 0; axis < 3; axis++) {
        state->origin[axis] = state->ray->origin[axis];
        state->direction[axis] = state->ray->direction[axis];
    }
}

/* Starts a ray in world space. */
static inline bool traverse_state_start(struct traverse_state *state, const struct ray *ray,
                                        const struct traverse_options *options)
{
    bool is_possible = traverse_state_begin(state, ray, options);
    traverse_state_to_world(state);
    return is_possible;
}

/* The inverse of an instance's matrix in double, without the translation: rows times the scale. */
struct traverse_inverse {
    double rows[3][3], scale;
};

void traverse_inverse_init(const float object_to_world[12], struct traverse_inverse *ret_inverse);

/* Puts the ray into the object space of an instance. */
void traverse_state_to_object(struct traverse_state *state, const float object_to_world[12]);

/* Returns the opacity: the ray's flags take precedence over the instance's, and those over the geometry's. */
static inline enum traverse_opacity traverse_state_opacity(uint32_t ray_flags, uint32_t instance_flags)
{
    if (ray_flags & (RAY_OPAQUE | RAY_NO_OPAQUE))
        return ray_flags & RAY_OPAQUE ? OPACITY_OPAQUE : OPACITY_NO_OPAQUE;
    if (instance_flags & (INSTANCE_FORCE_OPAQUE | INSTANCE_FORCE_NO_OPAQUE))
        return instance_flags & INSTANCE_FORCE_OPAQUE ? OPACITY_OPAQUE : OPACITY_NO_OPAQUE;
    return OPACITY_AS_BUILT;
}

/* Does the work of traverse_state_settle() for a plain ray in a bottom level without a top level. */
static inline void traverse_state_settle_plain(struct traverse_state *state)
{
    state->instance = (struct traverse_instance){.instance = RAY_NO_INSTANCE};
    state->is_plain = true; /* so culling and opacity are not used */
    state->is_flipped = false;
}

/* Does the work of traverse_state_enter() except for the triangle_ray. */
static inline bool traverse_state_settle(struct traverse_state *state, const struct traverse_instance *instance,
                                         uint32_t skip_flag, bool is_triangles)
{
    static const struct traverse_instance no_instance = {.instance = RAY_NO_INSTANCE};
    uint32_t ray_flags = state->ray->flags, instance_flags = instance ? instance->sbt_and_flags >> 24 : 0;
    if (ray_flags & skip_flag)
        return false;
    state->instance = instance ? *instance : no_instance;
    state->is_plain =
        is_triangles && !(ray_flags & ~(uint32_t)RAY_TERMINATE_ON_FIRST_HIT) && !state->options->candidate;
    if (state->is_plain) {
        /* Culling and opacity are not used. */
        state->is_flipped = instance_flags & INSTANCE_FLIP_FACING;
        return true;
    }
    state->opacity = traverse_state_opacity(ray_flags, instance_flags);
    bool is_flipped = instance_flags & INSTANCE_FLIP_FACING, is_culled = !(instance_flags & INSTANCE_CULL_DISABLE);
    state->is_flipped = is_flipped;
    state->cull_front = is_culled && (ray_flags & (is_flipped ? RAY_CULL_BACK_FACING : RAY_CULL_FRONT_FACING));
    state->cull_back = is_culled && (ray_flags & (is_flipped ? RAY_CULL_FRONT_FACING : RAY_CULL_BACK_FACING));
    return true;
}

/*
 * Prepares the state for the primitives of a bottom level; the ray is already in its space. `instance` is NULL if there
 * is no top level. Returns false if the ray skips all primitives, because it has the flag `skip_flag`.
 */
bool traverse_state_enter(struct traverse_state *state, const struct traverse_instance *instance, uint32_t skip_flag,
                          bool is_triangles);

/* Returns whether the ray can hit anything in its current space. */
bool traverse_state_is_usable(const struct traverse_state *state);

/* Process one primitive at a leaf (traverse_leaf.c). `record` is its row in the layout's terms. */
void traverse_leaf_triangle(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque,
                            const float *const corners[3]);
/* Does the same for a triangle that the ray's line meets. Nothing happens unless tmin < t <= the state's tmax. */
void traverse_leaf_hit(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque,
                       const struct triangle_hit *hit);
/* Does the same for a sphere or a linear swept sphere that the ray's line enters at t. */
void traverse_leaf_round(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque, double t,
                         double u);
void traverse_leaf_aabb(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque, const float min[3],
                        const float max[3]);

/* Converts the answer to the caller's terms (traverse_leaf.c). */
void traverse_leaf_describe(const struct traverse_state *state, const struct traverse_found *found,
                            const struct traverse_instance *instance, struct ray_hit *ret_hit);

/* Ends a ray: adds up the counters and returns the answer. */
static inline bool traverse_state_finish(const struct traverse_state *state, struct ray_hit *ret_hit,
                                         struct traverse_counters *counters)
{
    if (counters) {
        counters->nodes += state->counters.nodes;
        counters->triangles += state->counters.triangles;
        counters->instances += state->counters.instances;
    }
    if (state->is_hit)
        traverse_leaf_describe(state, &state->best, &state->best_instance, ret_hit);
    return state->is_hit;
}

#endif
