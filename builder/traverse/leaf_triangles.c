/* SPDX-License-Identifier: Apache-2.0 */
/* leaf_triangles.c - leaves of triangles and of motion triangles. */
#include "builder/traverse/leaf_kind.h"
#include "builder/traverse/motion.h"

static void visit_triangles(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    struct traverse_state *state = &walk->state;
    for (uint32_t i = 0; i < count && !state->is_done; i++) {
        uint32_t record = first + (state->options->flip_order ? count - 1 - i : i);
        const float *corners[3];
        uint32_t id = traverse_corners(walk->view, record, corners);
        state->counters.triangles++;
        traverse_leaf_triangle(state, record, id & PORTABLE_ID_MASK, id & PORTABLE_ID_OPAQUE, corners);
    }
}

static void visit_moving_triangles(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    struct traverse_state *state = &walk->state;
    const struct motion_weights at = motion_weights_at(state->ray->time);
    for (uint32_t i = 0; i < count && !state->is_done; i++) {
        uint32_t record = first + (state->options->flip_order ? count - 1 - i : i);
        float places[3][3];
        uint32_t id = motion_corners(walk->view, record, at, places);
        const float *const corners[3] = {places[0], places[1], places[2]};
        state->counters.triangles++;
        traverse_leaf_triangle(state, record, id & PORTABLE_ID_MASK, id & PORTABLE_ID_OPAQUE, corners);
    }
}

static void grow(const struct portable_view *view, uint32_t first, uint32_t count, struct box *box)
{
    for (uint32_t record = first; record < first + count; record++) {
        const float *corners[3];
        traverse_corners(view, record, corners);
        for (int k = 0; k < 3; k++)
            box_add_point(box, corners[k]);
    }
}

const struct leaf_kind leaf_triangles = {
    .skip_flag = RAY_SKIP_TRIANGLES,
    .is_triangles = true,
    .has_packets = true,
    .packs_any = true,
    .can_unpack = true,
    .unpacks_few = true,
    .visit = visit_triangles,
    .walk_avx2 = traverse_avx2_triangles,
    .walk_plain = traverse_avx2_plain,
    .grow = grow,
};

const struct leaf_kind leaf_moving_triangles = {
    .skip_flag = RAY_SKIP_TRIANGLES,
    .is_triangles = true,
    .has_packets = true,
    .packs_any = true,
    .moves = true,
    .visit = visit_moving_triangles,
    .walk_avx2 = traverse_avx2_moving,
    .walk_world = traverse_avx2_moving_world,
};
