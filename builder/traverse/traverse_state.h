/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_state.h - one ray on its way, whatever the layout: the semantics of traverse.h, which exist once. Internal.
 *
 * A layout's traversal brings what walks its nodes and reads its leaves. For each bottom level that the ray comes to,
 * it says so (traverse_state_enter, before that traverse_state_to_object for that of an instance), and hands over what
 * lies at the leaves that the ray may meet (traverse_leaf_...), as long as is_done is not set and up to the distance
 * tmax.
 */
#ifndef BVHD_TRAVERSE_STATE_H
#define BVHD_TRAVERSE_STATE_H

#include "builder/traverse/boxtest.h"
#include "builder/traverse/traverse.h"
#include "builder/traverse/triangle.h"

/* Through which instance a bottom level is seen. */
struct traverse_instance {
    uint32_t custom_and_mask, sbt_and_flags; /* as in Vulkan's record */
    uint32_t instance; /* position in the request; RAY_NO_INSTANCE without a top level */
    uint32_t bottom; /* row of the scene's bottoms */
};

/* Something that was hit, or may be. */
struct traverse_found {
    double t, u, v;
    /* of the primitive in its bottom level, in the layout's terms: in the order of (geometry, primitive) */
    uint64_t id;
    uint32_t record;
    bool is_opaque; /* its geometry is */
    bool front_face, is_aabb;
};

/* Whether primitives count as opaque. */
enum traverse_opacity { OPACITY_AS_BUILT, OPACITY_OPAQUE, OPACITY_NO_OPAQUE };

struct traverse_state {
    const struct ray *ray;
    const struct traverse_options *options; /* never NULL */
    struct traverse_counters counters;

    /* The layout's: which primitive an id is. */
    void (*identify)(const struct traverse_state *state, uint32_t bottom, uint64_t id, uint32_t *ret_geometry,
                     uint32_t *ret_primitive);

    /* What is of interest ends here: the closest hit so far, else the ray's tmax. */
    double tmax;
    float tmax_above; /* rounded up */
    bool is_hit, is_done;
    struct traverse_found best;
    struct traverse_instance best_instance;

    /* The bottom level that is being traversed, and the ray in its space. */
    struct traverse_instance instance;
    bool cull_front, cull_back, is_flipped;
    bool is_plain; /* no triangle is culled, nobody is asked about one */
    enum traverse_opacity opacity;
    double origin[3], direction[3];
    struct triangle_ray triangle_ray;
};

/* Begins. The ray is nowhere yet. False: its interval is empty, and nothing is hit. */
static inline bool traverse_state_begin(struct traverse_state *state, const struct ray *ray,
                                        const struct traverse_options *options)
{
    /* Field by field: clearing all of it costs more than a short traversal. */
    static const struct traverse_options defaults = {0};
    state->ray = ray;
    state->options = options ? options : &defaults;
    state->counters = (struct traverse_counters){0, 0, 0};
    state->tmax = ray->tmax;
    state->tmax_above = ray->tmax;
    state->is_hit = state->is_done = false;
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

/* Begins in world space. */
static inline bool traverse_state_start(struct traverse_state *state, const struct ray *ray,
                                        const struct traverse_options *options)
{
    bool is_possible = traverse_state_begin(state, ray, options);
    traverse_state_to_world(state);
    return is_possible;
}

/* Puts the ray into the space of an instance. */
void traverse_state_to_object(struct traverse_state *state, const float object_to_world[12]);

/* Opacity: the ray's flags come before the instance's, those before the geometry's. */
static inline enum traverse_opacity traverse_state_opacity(uint32_t ray_flags, uint32_t instance_flags)
{
    if (ray_flags & (RAY_OPAQUE | RAY_NO_OPAQUE))
        return ray_flags & RAY_OPAQUE ? OPACITY_OPAQUE : OPACITY_NO_OPAQUE;
    if (instance_flags & (INSTANCE_FORCE_OPAQUE | INSTANCE_FORCE_NO_OPAQUE))
        return instance_flags & INSTANCE_FORCE_OPAQUE ? OPACITY_OPAQUE : OPACITY_NO_OPAQUE;
    return OPACITY_AS_BUILT;
}

/* traverse_state_enter() but for the triangle_ray. */
static inline bool traverse_state_settle(struct traverse_state *state, const struct traverse_instance *instance,
                                         bool is_aabbs)
{
    static const struct traverse_instance no_instance = {.instance = RAY_NO_INSTANCE};
    uint32_t ray_flags = state->ray->flags, instance_flags = instance ? instance->sbt_and_flags >> 24 : 0;
    if (ray_flags & (is_aabbs ? RAY_SKIP_AABBS : RAY_SKIP_TRIANGLES))
        return false;
    state->instance = instance ? *instance : no_instance;
    state->is_plain = !is_aabbs && !(ray_flags & ~(uint32_t)RAY_TERMINATE_ON_FIRST_HIT) && !state->options->candidate;
    if (state->is_plain) {
        /* Neither culling nor opacity is looked at. */
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
 * Makes the state ready for the primitives of a bottom level; the ray is in its space already. `instance` NULL: there
 * is no top level. False: the ray's flags skip all of them.
 */
bool traverse_state_enter(struct traverse_state *state, const struct traverse_instance *instance, bool is_aabbs);

/* Whether the ray, in the space that it is in, can hit anything. */
bool traverse_state_is_usable(const struct traverse_state *state);

/* traverse_leaf.c: one primitive at a leaf. `record` is its row in the layout's terms. */
void traverse_leaf_triangle(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque,
                            const float *const corners[3]);
/* The same of a triangle that the ray's line meets. Nothing happens unless tmin < t <= the state's tmax. */
void traverse_leaf_hit(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque,
                       const struct triangle_hit *hit);
void traverse_leaf_aabb(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque, const float min[3],
                        const float max[3]);

/* traverse_leaf.c: the answer in the caller's terms. */
void traverse_leaf_describe(const struct traverse_state *state, const struct traverse_found *found,
                            const struct traverse_instance *instance, struct ray_hit *ret_hit);

/* The answer. */
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
