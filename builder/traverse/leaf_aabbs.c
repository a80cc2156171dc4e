/* SPDX-License-Identifier: Apache-2.0 */
/* leaf_aabbs.c - leaves of AABBs. */
#include "builder/traverse/leaf_kind.h"

static void visit_aabbs(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    struct traverse_state *state = &walk->state;
    for (uint32_t i = 0; i < count && !state->is_done; i++) {
        uint32_t record = first + (state->options->flip_order ? count - 1 - i : i);
        const struct portable_aabb *aabb = (const struct portable_aabb *)walk->view->records + record;
        state->counters.triangles++;
        traverse_leaf_aabb(state, record, aabb->id & PORTABLE_ID_MASK, aabb->id & PORTABLE_ID_OPAQUE, aabb->min,
                           aabb->max);
    }
}

const struct leaf_kind leaf_aabbs = {
    .skip_flag = RAY_SKIP_AABBS,
    .visit = visit_aabbs,
};
