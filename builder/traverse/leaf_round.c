/* SPDX-License-Identifier: Apache-2.0 */
/* leaf_round.c - leaves of spheres, and of linear swept spheres. */
#include "builder/format/swept_shape.h"
#include "builder/traverse/leaf_kind.h"
#include "builder/traverse/round_records.h"
#include "builder/traverse/sphere.h"
#include "builder/traverse/swept_sphere.h"

void round_prepare(struct traverse_state *state, enum traverse_kind kind)
{
    round_ray_init(state->origin, state->direction, state->ray->tmin, &state->round_ray);
    state->round_kind = kind;
}

static void prepare_spheres(struct traverse_state *state)
{
    round_prepare(state, MET_SPHERE);
}

static void prepare_swept_spheres(struct traverse_state *state)
{
    round_prepare(state, MET_SWEPT_SPHERE);
}

static unsigned caps_of(const struct portable_round *round)
{
    return (round->id & PORTABLE_ID_CAP_FIRST ? SWEPT_SHAPE_CAP_FIRST : 0) |
           (round->id & PORTABLE_ID_CAP_SECOND ? SWEPT_SHAPE_CAP_SECOND : 0);
}

void round_meet_sphere(struct traverse_state *state, const struct portable_view *view, uint32_t record)
{
    const struct portable_round *round = round_record_at(view, record);
    double t;
    if (sphere_intersect(&state->round_ray, round_vertex_of(view, round), &t))
        traverse_leaf_round(state, record, round->id & PORTABLE_ID_MASK, round->id & PORTABLE_ID_OPAQUE, t, 0);
}

void round_meet_swept(struct traverse_state *state, const struct portable_view *view, uint32_t record)
{
    const struct portable_round *round = round_record_at(view, record);
    const float *ends = round_vertex_of(view, round);
    struct swept_sphere_hit hit;
    if (swept_sphere_intersect(&state->round_ray, ends, ends + 4, caps_of(round), &hit))
        traverse_leaf_round(state, record, round->id & PORTABLE_ID_MASK, round->id & PORTABLE_ID_OPAQUE, hit.t, hit.u);
}

void round_meet_cap(struct traverse_state *state, const struct portable_view *view, uint32_t record, unsigned end)
{
    const struct portable_round *round = round_record_at(view, record);
    double t;
    if (caps_of(round) >> end & 1 &&
        sphere_intersect(&state->round_ray, round_vertex_of(view, round) + (uint64_t)4 * end, &t))
        traverse_leaf_round(state, record, round->id & PORTABLE_ID_MASK, round->id & PORTABLE_ID_OPAQUE, t, end);
}

static void visit_spheres(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    const bool is_flipped = walk->state.options->flip_order;
    for (uint32_t i = 0; i < count && !walk->state.is_done; i++) {
        walk->state.counters.triangles++;
        round_meet_sphere(&walk->state, walk->view, first + (is_flipped ? count - 1 - i : i));
    }
}

static void visit_swept_spheres(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    const bool is_flipped = walk->state.options->flip_order;
    for (uint32_t i = 0; i < count && !walk->state.is_done; i++) {
        walk->state.counters.triangles++;
        round_meet_swept(&walk->state, walk->view, first + (is_flipped ? count - 1 - i : i));
    }
}

static void grow_spheres(const struct portable_view *view, uint32_t first, uint32_t count, struct box *box)
{
    for (uint32_t i = first; i < first + count; i++) {
        const struct box own = swept_shape_sphere(round_vertex_of(view, round_record_at(view, i)));
        box_add_point(box, own.min);
        box_add_point(box, own.max);
    }
}

static void grow_swept_spheres(const struct portable_view *view, uint32_t first, uint32_t count, struct box *box)
{
    for (uint32_t i = first; i < first + count; i++) {
        const struct portable_round *round = round_record_at(view, i);
        const float *ends = round_vertex_of(view, round);
        const struct box own = swept_shape_box(ends, ends + 4, caps_of(round));
        box_add_point(box, own.min);
        box_add_point(box, own.max);
    }
}

const struct leaf_kind leaf_spheres = {
    .skip_flag = RAY_SKIP_TRIANGLES,
    .prepare = prepare_spheres,
    .can_unpack = true,
    .shape_floats = UNPACKED_SPHERE,
    .has_packets = true,
    .visit = visit_spheres,
    .walk_avx2 = traverse_avx2_round,
    .walk_plain = traverse_avx2_round_plain,
    .grow = grow_spheres,
};

const struct leaf_kind leaf_swept_spheres = {
    .skip_flag = RAY_SKIP_TRIANGLES,
    .prepare = prepare_swept_spheres,
    .can_unpack = true,
    .shape_floats = UNPACKED_SWEPT,
    .has_packets = true,
    .visit = visit_swept_spheres,
    .walk_avx2 = traverse_avx2_round,
    .walk_plain = traverse_avx2_round_plain,
    .grow = grow_swept_spheres,
};
