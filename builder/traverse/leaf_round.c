/* SPDX-License-Identifier: Apache-2.0 */
/* leaf_round.c - leaves of spheres, and of linear swept spheres. */
#include "builder/format/swept_shape.h"
#include "builder/traverse/leaf_kind.h"
#include "builder/traverse/sphere.h"
#include "builder/traverse/swept_sphere.h"

static void prepare(struct traverse_state *state)
{
    round_ray_init(state->origin, state->direction, state->ray->tmin, &state->round_ray);
}

static const struct portable_round *record_at(const struct portable_view *view, uint32_t record)
{
    return (const struct portable_round *)view->records + record;
}

/* Returns the vertex of a record. A linear swept sphere's second end follows it. */
static const float *vertex_of(const struct portable_view *view, const struct portable_round *round)
{
    return view->vertices + (uint64_t)4 * round->vertex;
}

static unsigned caps_of(const struct portable_round *round)
{
    return (round->id & PORTABLE_ID_CAP_FIRST ? SWEPT_SHAPE_CAP_FIRST : 0) |
           (round->id & PORTABLE_ID_CAP_SECOND ? SWEPT_SHAPE_CAP_SECOND : 0);
}

/* Which of a leaf's records is visited in turn number i. */
static uint32_t in_turn(const struct traverse_state *state, uint32_t first, uint32_t count, uint32_t i)
{
    return first + (state->options->flip_order ? count - 1 - i : i);
}

static void visit_spheres(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    struct traverse_state *state = &walk->state;
    for (uint32_t i = 0; i < count && !state->is_done; i++) {
        const uint32_t record = in_turn(state, first, count, i);
        const struct portable_round *round = record_at(walk->view, record);
        double t;
        if (sphere_intersect(&state->round_ray, vertex_of(walk->view, round), &t))
            traverse_leaf_round(state, record, round->id & PORTABLE_ID_MASK, round->id & PORTABLE_ID_OPAQUE, t, 0);
    }
}

static void visit_swept_spheres(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    struct traverse_state *state = &walk->state;
    for (uint32_t i = 0; i < count && !state->is_done; i++) {
        const uint32_t record = in_turn(state, first, count, i);
        const struct portable_round *round = record_at(walk->view, record);
        const float *ends = vertex_of(walk->view, round);
        struct swept_sphere_hit hit;
        if (swept_sphere_intersect(&state->round_ray, ends, ends + 4, caps_of(round), &hit))
            traverse_leaf_round(state, record, round->id & PORTABLE_ID_MASK, round->id & PORTABLE_ID_OPAQUE, hit.t,
                                hit.u);
    }
}

static void grow_spheres(const struct portable_view *view, uint32_t first, uint32_t count, struct box *box)
{
    for (uint32_t i = first; i < first + count; i++) {
        const struct box own = swept_shape_sphere(vertex_of(view, record_at(view, i)));
        box_add_point(box, own.min);
        box_add_point(box, own.max);
    }
}

static void grow_swept_spheres(const struct portable_view *view, uint32_t first, uint32_t count, struct box *box)
{
    for (uint32_t i = first; i < first + count; i++) {
        const float *ends = vertex_of(view, record_at(view, i));
        const struct box own = swept_shape_box(ends, ends + 4, caps_of(record_at(view, i)));
        box_add_point(box, own.min);
        box_add_point(box, own.max);
    }
}

const struct leaf_kind leaf_spheres = {
    .skip_flag = RAY_SKIP_TRIANGLES,
    .prepare = prepare,
    .visit = visit_spheres,
    .grow = grow_spheres,
};

const struct leaf_kind leaf_swept_spheres = {
    .skip_flag = RAY_SKIP_TRIANGLES,
    .prepare = prepare,
    .visit = visit_swept_spheres,
    .grow = grow_swept_spheres,
};
