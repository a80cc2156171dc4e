/* SPDX-License-Identifier: Apache-2.0 */
/* traverse_leaf.c - what a ray does at a leaf: intersections, opacity, facing, candidates, and which of two hits is the answer. */
#include "traverse_state.h"

static uint32_t flat_id(const struct traverse_found *found)
{
    return found->id & PORTABLE_ID_MASK;
}

static uint32_t instance_of(const struct traverse_found *found)
{
    return found->instance ? found->instance->instance : RAY_NO_INSTANCE;
}

void traverse_leaf_describe(const struct traverse_found *found, struct ray_hit *ret_hit)
{
    const struct portable_instance *instance = found->instance;
    uint32_t geometry = portable_geometry_of(found->view, flat_id(found));
    *ret_hit = (struct ray_hit){
        .t = (float)found->t,
        .u = (float)found->u,
        .v = (float)found->v,
        .instance = instance_of(found),
        .custom_index = instance ? instance->custom_and_mask & 0xffffff : 0,
        .sbt_offset = instance ? instance->sbt_and_flags & 0xffffff : 0,
        .geometry = geometry,
        .primitive = flat_id(found) - found->view->geometries[geometry].first_primitive,
        .record = found->record,
        .handle = instance ? instance->handle : 0,
        .front_face = found->front_face,
        .is_aabb = found->is_aabb,
    };
}

/* The order of equal t. Flat ids are in the order of (geometry, primitive). */
static inline bool comes_first(const struct traverse_found *a, const struct traverse_found *b)
{
    uint32_t instance_a = instance_of(a), instance_b = instance_of(b);
    return instance_a != instance_b ? instance_a < instance_b : flat_id(a) < flat_id(b);
}

/* Whether `found` could become the answer: triangles within the open interval, AABBs within the closed one, then the closest. */
static inline bool is_better(const struct traverse_state *state, const struct traverse_found *found)
{
    if (found->is_aabb ? !(found->t >= state->ray->tmin) : !(found->t > state->ray->tmin))
        return false;
    if (found->t == state->tmax)
        return state->is_hit ? comes_first(found, &state->best) : found->is_aabb;
    return found->t < state->tmax;
}

/* The next float, of one that is not infinite. */
static float next_up(float value)
{
    int32_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits = value == 0 ? 1 : bits + (bits < 0 ? -1 : 1);
    memcpy(&value, &bits, sizeof bits);
    return value;
}

static inline void accept(struct traverse_state *state, struct traverse_found found)
{
    float nearest = (float)found.t;
    state->best = found;
    state->tmax = found.t;
    state->tmax_above = nearest < found.t ? next_up(nearest) : nearest;
    state->is_hit = true;
    state->is_done = state->is_done || (state->ray->flags & RAY_TERMINATE_ON_FIRST_HIT);
}

static bool is_opaque(const struct traverse_state *state, uint32_t id)
{
    return state->opacity == OPACITY_AS_BUILT ? (id & PORTABLE_ID_OPAQUE) != 0 : state->opacity == OPACITY_OPAQUE;
}

/* Asks the caller about a candidate. */
static void offer(struct traverse_state *state, struct traverse_found found)
{
    struct ray_hit hit;
    traverse_leaf_describe(&found, &hit);
    enum candidate_verdict verdict = state->options->candidate(state->options->context, state->ray, &hit);
    if (verdict == CANDIDATE_IGNORE)
        return;
    if (found.is_aabb)
        found.t = hit.t;
    if (!is_better(state, &found))
        return;
    accept(state, found);
    state->is_done = state->is_done || verdict == CANDIDATE_ACCEPT_AND_END;
}

/* Values go by value here: kept in registers, they are stored once. */
static inline void consider(struct traverse_state *state, struct traverse_found found)
{
    bool opaque = is_opaque(state, found.id);
    if (!is_better(state, &found) || state->ray->flags & (opaque ? RAY_CULL_OPAQUE : RAY_CULL_NO_OPAQUE))
        return;
    if (state->options->candidate && (found.is_aabb || !opaque))
        offer(state, found);
    else
        accept(state, found);
}

void traverse_leaf_triangle(struct traverse_state *state, uint32_t record, uint32_t id, const float *const corners[3])
{
    struct triangle_hit hit;
    if (!triangle_intersect(&state->triangle_ray, corners[0], corners[1], corners[2], &hit))
        return;
    if (hit.front ? state->cull_front : state->cull_back)
        return;
    bool is_flipped = state->instance && (state->instance->sbt_and_flags >> 24 & INSTANCE_FLIP_FACING);
    struct traverse_found found = {
        .t = hit.t,
        .u = hit.u,
        .v = hit.v,
        .view = state->view,
        .instance = state->instance,
        .id = id,
        .record = record,
        .front_face = hit.front != is_flipped,
    };
    consider(state, found);
}

void traverse_leaf_triangles(struct traverse_state *state, uint32_t first, uint32_t count)
{
    for (uint32_t i = 0; i < count && !state->is_done; i++) {
        uint32_t record = first + (state->options->flip_order ? count - 1 - i : i);
        const float *corners[3];
        uint32_t id = traverse_corners(state->view, record, corners);
        state->counters.triangles++;
        traverse_leaf_triangle(state, record, id, corners);
    }
}

void traverse_leaf_aabbs(struct traverse_state *state, uint32_t first, uint32_t count)
{
    for (uint32_t i = 0; i < count && !state->is_done; i++) {
        uint32_t record = first + (state->options->flip_order ? count - 1 - i : i);
        const struct portable_aabb *aabb = (const struct portable_aabb *)state->view->records + record;
        struct traverse_found found = {
            .view = state->view,
            .instance = state->instance,
            .id = aabb->id,
            .record = record,
            .is_aabb = true,
        };
        if (!boxtest_aabb(state->origin, state->direction, aabb->min, aabb->max, state->ray->tmin, state->tmax, &found.t))
            continue;
        consider(state, found);
    }
}
