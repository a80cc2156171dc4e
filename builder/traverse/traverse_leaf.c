/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_leaf.c - what a ray does at a leaf: intersections, opacity, facing, any-hit callbacks, and the choice
 * between two hits.
 */
#include <float.h>
#include <math.h>

#include "builder/traverse/traverse_state.h"

void traverse_leaf_describe(const struct traverse_state *state, const struct traverse_found *found,
                            const struct traverse_instance *instance, struct ray_hit *ret_hit)
{
    uint32_t geometry, primitive;
    state->identify(state, instance->bottom, found->id, &geometry, &primitive);
    *ret_hit = (struct ray_hit){
        .t = (float)found->t,
        .u = (float)found->u,
        .v = (float)found->v,
        .instance = instance->instance,
        .custom_index = instance->custom_and_mask & 0xffffff,
        .geometry = geometry,
        .primitive = primitive,
        .front_face = found->front_face,
        .is_aabb = found->kind == MET_AABB,
        .is_sphere = found->kind == MET_SPHERE,
        .is_swept_sphere = found->kind == MET_SWEPT_SPHERE,
        .sbt_offset = instance->sbt_and_flags & 0xffffff,
        .handle = instance->bottom,
        .record = found->record,
        .instance_record = instance->record,
    };
}

/* The order of hits with equal t: whether this one comes before the best so far. */
static inline bool comes_first(const struct traverse_state *state, uint64_t id)
{
    uint32_t instance = state->instance.instance, best = state->best_instance.instance;
    return instance != best ? instance < best : id < state->best.id;
}

/*
 * Rounds a distance to 32 significant bits, within which distances count as equal. Triangles in one plane are at the
 * same distance except for the last bits of double, which must not choose among them. Shaders, which know distances to
 * about 40 bits, would choose others.
 */
static inline double round_distance(double t)
{
    uint64_t bits;
    memcpy(&bits, &t, sizeof bits);
    bits = (bits + (UINT64_C(1) << 20)) & ~((UINT64_C(1) << 21) - 1);
    memcpy(&t, &bits, sizeof t);
    return t;
}

/* Returns whether a hit comes before the best so far, if there is one. */
static inline bool is_closer(const struct traverse_state *state, double t, uint64_t id)
{
    if (!state->is_hit)
        return true;
    double rounded = round_distance(t), best = round_distance(state->best.t);
    return rounded == best ? comes_first(state, id) : rounded < best;
}

/* Returns whether `found` can become the answer: within the interval, and the closest. */
static inline bool is_better(const struct traverse_state *state, const struct traverse_found *found)
{
    double t = found->t, tmin = state->ray->tmin, tmax = state->ray->tmax;
    return (found->is_closed ? t >= tmin && t <= tmax : t > tmin && t < tmax) && is_closer(state, t, found->id);
}

/* Moves the end of the interval to t. A hit beyond it that still counts as equal can be the answer. */
static inline void shorten(struct traverse_state *state, double t)
{
    double rounded = round_distance(t), farthest_equal = rounded + 0x1p-31 * fabs(rounded);
    state->tmax = farthest_equal;
    /* A float that is not less, computed without a branch, because the direction of rounding is unpredictable. */
    state->tmax_above = (float)(farthest_equal + 0x1p-23 * fabs(farthest_equal) + FLT_MIN * FLT_EPSILON);
    state->best_instance = state->instance;
    state->is_hit = true;
    state->is_done = state->is_done || (state->ray->flags & RAY_TERMINATE_ON_FIRST_HIT);
}

static inline void accept(struct traverse_state *state, struct traverse_found found)
{
    state->best = found;
    shorten(state, found.t);
}

static bool is_opaque(const struct traverse_state *state, const struct traverse_found *found)
{
    return state->opacity == OPACITY_AS_BUILT ? found->is_opaque : state->opacity == OPACITY_OPAQUE;
}

/* Calls the any-hit callback for a candidate. */
static void offer(struct traverse_state *state, struct traverse_found found, bool opaque)
{
    const struct candidate_space space = {
        .origin = state->origin,
        .direction = state->direction,
        .object_to_world = state->object_to_world,
        .tmax = state->is_hit ? state->best.t : state->ray->tmax,
        .is_opaque = opaque,
    };
    struct ray_hit hit;
    traverse_leaf_describe(state, &found, &state->instance, &hit);
    enum candidate_verdict verdict = state->options->candidate(state->options->context, state->ray, &space, &hit);
    bool is_end = verdict & CANDIDATE_IGNORE_AND_END;
    if (!(verdict & CANDIDATE_ACCEPT)) {
        state->is_done = state->is_done || is_end;
        return;
    }
    if (found.kind == MET_AABB)
        found.t = hit.t;
    if (!is_better(state, &found))
        return;
    accept(state, found);
    state->is_done = state->is_done || is_end;
}

/* Takes the struct by value, which keeps it in registers until it is stored once. */
static inline void consider(struct traverse_state *state, struct traverse_found found)
{
    bool opaque = is_opaque(state, &found);
    if (!is_better(state, &found) || state->ray->flags & (opaque ? RAY_CULL_OPAQUE : RAY_CULL_NO_OPAQUE))
        return;
    if (state->options->candidate && (found.kind == MET_AABB || !opaque))
        offer(state, found, opaque);
    else
        accept(state, found);
}

/*
 * Accepts a triangle that counts whatever its facing and opacity, without a callback, as for nearly all rays. It stores
 * the fields one by one.
 */
static inline void take(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque,
                        const struct triangle_hit *hit)
{
    double t = hit->t;
    if (!(t > state->ray->tmin && t < state->ray->tmax && is_closer(state, t, id)))
        return;
    state->best.t = t;
    state->best.u = hit->u;
    state->best.v = hit->v;
    state->best.id = id;
    state->best.record = record;
    state->best.is_opaque = is_opaque;
    state->best.front_face = hit->front != state->is_flipped;
    state->best.kind = MET_TRIANGLE;
    shorten(state, t);
}

void traverse_leaf_hit(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque,
                       const struct triangle_hit *hit)
{
    if (state->is_plain) {
        take(state, record, id, is_opaque, hit);
        return;
    }
    if (hit->front ? state->cull_front : state->cull_back)
        return;
    struct traverse_found found = {
        .t = hit->t,
        .u = hit->u,
        .v = hit->v,
        .id = id,
        .record = record,
        .is_opaque = is_opaque,
        .front_face = hit->front != state->is_flipped,
    };
    consider(state, found);
}

void traverse_leaf_triangle(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque,
                            const float *const corners[3])
{
    struct triangle_hit hit;
    if (triangle_intersect(&state->triangle_ray, corners[0], corners[1], corners[2], &hit))
        traverse_leaf_hit(state, record, id, is_opaque, &hit);
}

/* Does for round kinds what take() does for triangles. */
static inline void take_round(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque, double t,
                              double u)
{
    if (!(t > state->ray->tmin && t < state->ray->tmax && is_closer(state, t, id)))
        return;
    state->best.t = t;
    state->best.u = u;
    state->best.v = 0;
    state->best.id = id;
    state->best.record = record;
    state->best.is_opaque = is_opaque;
    state->best.front_face = true;
    state->best.kind = (uint8_t)state->round_kind;
    shorten(state, t);
}

void traverse_leaf_round(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque, double t, double u)
{
    if (state->is_plain) {
        take_round(state, record, id, is_opaque, t, u);
        return;
    }
    const struct traverse_found found = {
        .t = t,
        .u = u,
        .id = id,
        .record = record,
        .is_opaque = is_opaque,
        .front_face = true,
        .kind = (uint8_t)state->round_kind,
    };
    consider(state, found);
}

void traverse_leaf_aabb(struct traverse_state *state, uint32_t record, uint64_t id, bool is_opaque, const float min[3],
                        const float max[3])
{
    struct traverse_found found = {
        .id = id, .record = record, .is_opaque = is_opaque, .kind = MET_AABB, .is_closed = true};
    if (boxtest_aabb(state->origin, state->direction, min, max, state->ray->tmin, state->tmax, &found.t))
        consider(state, found);
}
