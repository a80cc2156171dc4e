/* SPDX-License-Identifier: Apache-2.0 */
/*
 * avx2_walk.h - one ray through one structure of triangles with AVX2: its data, and the walks from a node on. Internal:
 * traverse_avx2.c begins them at the root, and packet_avx2.c where few rays of a packet are left.
 */
#ifndef BVHD_AVX2_WALK_H
#define BVHD_AVX2_WALK_H

#include "builder/traverse/boxtest_setup.h"
#include "builder/traverse/traverse_walk.h"
#include "builder/traverse/triangle_avx2.h"

#ifdef BOXTEST_AVX2

/* Each level leaves at most 7 siblings on the stack; the last one can add all 8. */
enum { AVX2_STACK_SIZE = 7 * PORTABLE_MAX_DEPTH + 1 };

/* The data of one ray through triangles. */
struct avx2_walk {
    struct traverse_state *state;
    const struct portable_view *view;
    const struct unpacked_node *unpacked; /* NULL: the portable nodes are traversed */
    struct boxtest_ray boxes;
    struct boxtest_scales scales; /* for unpacked nodes */
    struct triangle_avx2_ray triangles;
};

/*
 * Returns whether a ray may use unpacked nodes: their box test needs a tmin that is not negative, and a callback is
 * asked in the order of the portable nodes, on which its answer may depend.
 */
static inline bool avx2_walk_can_unpack(const struct traverse_state *state)
{
    return state->ray->tmin >= 0 && !state->options->candidate;
}

/*
 * Prepares a ray in world space, of which the state is settled. Returns false if boxes have to be tested in another
 * way.
 */
BOXTEST_AVX2_INLINE bool avx2_walk_init(struct avx2_walk *walk, struct traverse_state *state,
                                        const struct portable_view *view, const struct unpacked_node *unpacked)
{
    const __m128 origin = _mm_loadu_ps(state->ray->origin), direction = _mm_loadu_ps(state->ray->direction);
    walk->state = state;
    walk->view = view;
    walk->unpacked = avx2_walk_can_unpack(state) ? unpacked : NULL;
    if (!setup_floats(origin, direction, state->ray->tmin, view->header->bounds, &walk->boxes))
        return false;
    triangle_avx2_init(origin, direction, &state->triangle_ray, &walk->triangles);
    if (walk->unpacked)
        walk->scales = unpacked_scales(&walk->boxes);
    return true;
}

/* Does the same for a ray in any space, of which the state has the triangle_ray, too. */
BOXTEST_AVX2_INLINE bool avx2_walk_init_object(struct avx2_walk *walk, struct traverse_state *state,
                                               const struct portable_view *view, const struct unpacked_node *unpacked)
{
    walk->state = state;
    walk->view = view;
    walk->unpacked = avx2_walk_can_unpack(state) ? unpacked : NULL;
    if (!boxtest_init_avx2(state->origin, state->direction, state->ray->tmin, view->header->bounds, &walk->boxes))
        return false;
    triangle_avx2_spread(&state->triangle_ray, &walk->triangles);
    if (walk->unpacked)
        walk->scales = unpacked_scales(&walk->boxes);
    return true;
}

/* Walk an unpacked structure from a child on. */
void avx2_walk_closest(struct avx2_walk *walk, uint32_t child);
void avx2_walk_any(struct avx2_walk *walk, uint32_t node);

#endif
#endif
