/* SPDX-License-Identifier: Apache-2.0 */
/*
 * avx2_walk.h - one ray through one structure of triangles with AVX2: its data, and the walks from a node on. Internal:
 * traverse_avx2.c begins them at the root, turns_avx2.c, too, for some rays at a time, and packet_avx2.c where few rays
 * of a packet are left.
 */
#ifndef BVHD_AVX2_WALK_H
#define BVHD_AVX2_WALK_H

#include "builder/traverse/boxtest_setup.h"
#include "builder/traverse/motion.h"
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
    bool has_triangles; /* `triangles` and the state's triangle_ray are prepared */
    /* Only of motion triangles, which have these instead of `unpacked`: */
    const struct unpacked_moving_node *moving_nodes;
    const struct unpacked_moving_triangle *moving_triangles;
    struct motion_weights at;
};

/*
 * Returns whether a ray may use unpacked nodes: their box test needs a tmin that is not negative, and a callback is
 * asked in the order of the portable nodes, on which its answer may depend.
 */
static inline bool avx2_walk_can_unpack(const struct traverse_state *state)
{
    return state->ray->tmin >= 0 && !state->options->candidate;
}

/* Prepares a ray in world space for triangles. */
BOXTEST_AVX2_INLINE void avx2_walk_init_triangles(struct avx2_walk *walk)
{
    const struct ray *ray = walk->state->ray;
    triangle_avx2_init(_mm_loadu_ps(ray->origin), _mm_loadu_ps(ray->direction), &walk->state->triangle_ray,
                       &walk->triangles);
    walk->has_triangles = true;
}

/*
 * Prepares a plain ray in world space, of which the state is settled, for unpacked nodes, but not yet for triangles: a
 * fifth of the work, which many rays do not need. Returns false if boxes have to be tested in another way.
 */
BOXTEST_AVX2_INLINE bool avx2_walk_init_nodes(struct avx2_walk *walk, struct traverse_state *state,
                                              const struct portable_view *view, const struct unpacked_node *unpacked)
{
    const struct ray *ray = state->ray;
    walk->state = state;
    walk->view = view;
    walk->unpacked = unpacked;
    walk->has_triangles = false;
    if (!setup_floats(_mm_loadu_ps(ray->origin), _mm_loadu_ps(ray->direction), ray->tmin, view->header->bounds,
                      &walk->boxes))
        return false;
    walk->scales = unpacked_scales(&walk->boxes);
    return true;
}

/*
 * Prepares a ray in world space, of which the state is settled. Returns false if boxes have to be tested in another
 * way.
 */
BOXTEST_AVX2_INLINE bool avx2_walk_init(struct avx2_walk *walk, struct traverse_state *state,
                                        const struct portable_view *view, const struct unpacked_node *unpacked)
{
    const struct ray *ray = state->ray;
    walk->state = state;
    walk->view = view;
    walk->unpacked = avx2_walk_can_unpack(state) ? unpacked : NULL;
    if (!setup_floats(_mm_loadu_ps(ray->origin), _mm_loadu_ps(ray->direction), ray->tmin, view->header->bounds,
                      &walk->boxes))
        return false;
    avx2_walk_init_triangles(walk);
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
    walk->has_triangles = true;
    if (walk->unpacked)
        walk->scales = unpacked_scales(&walk->boxes);
    return true;
}

/* How far a walk has come, for rays that take turns. */
struct avx2_cursor {
    union {
        struct {
            uint32_t child; /* the next one */
            uint64_t *top, stack[AVX2_STACK_SIZE]; /* the children after it, with their distances */
        } closest;
        struct {
            const struct unpacked_node *node; /* the last one, and the slots of its leaves that the ray meets next */
            unsigned leaves;
            uint32_t *top, stack[AVX2_STACK_SIZE]; /* the nodes after it */
        } any;
    };
};

/* Puts the cursor at the root. */
static inline void avx2_cursor_begin(struct avx2_cursor *cursor, bool is_any)
{
    if (is_any) {
        cursor->any.node = NULL;
        cursor->any.leaves = 0;
        cursor->any.top = cursor->any.stack;
        *cursor->any.top++ = 0;
    } else {
        cursor->closest.child = CHILD_ROOT;
        cursor->closest.top = cursor->closest.stack;
    }
}

/*
 * Go on through an unpacked structure until the next child may have to come from memory, which they begin to fetch.
 * They return false when the walk is finished.
 */
bool avx2_walk_on_closest(struct avx2_walk *walk, struct avx2_cursor *cursor);
bool avx2_walk_on_any(struct avx2_walk *walk, struct avx2_cursor *cursor);

/* Walk an unpacked structure from a child on. */
void avx2_walk_closest(struct avx2_walk *walk, uint32_t child);
void avx2_walk_any(struct avx2_walk *walk, uint32_t node);

/* Do the same with motion triangles (moving_avx2.c). A cursor has the node at t = 0 with which a moving one begins. */
void moving_walk_closest(struct avx2_walk *walk, uint32_t child);
void moving_walk_any(struct avx2_walk *walk, uint32_t node);
bool moving_walk_on_closest(struct avx2_walk *walk, struct avx2_cursor *cursor);
bool moving_walk_on_any(struct avx2_walk *walk, struct avx2_cursor *cursor);

/*
 * Prepares a ray for unpacked motion triangles. The state has its triangle_ray. Returns false if boxes have to be
 * tested in another way.
 */
bool moving_walk_init(struct avx2_walk *walk, struct traverse_state *state, const struct portable_view *view,
                      const struct unpacked_node *unpacked);

/* Does the same for a ray in world space, exactly as the caller gave it, but does not prepare it for triangles yet. */
bool moving_walk_init_world(struct avx2_walk *walk, struct traverse_state *state, const struct portable_view *view,
                            const struct unpacked_node *unpacked);

/* Returns planes of a moving node at a time; boxtest_moving.h has the bound of their error. */
BOXTEST_AVX2_INLINE __m256 moving_planes_at(const struct unpacked_moving_node *node, uint32_t offset, __m256 time)
{
    const __m256 moved = unpacked_planes_at(&node->start, offset + (uint32_t)sizeof node->start);
    return _mm256_fmadd_ps(moved, time, unpacked_planes_at(&node->start, offset));
}

/* Returns a corner at a time, with the operations of motion_number(); the fourth lane is unused. */
BOXTEST_AVX2_INLINE __m128 moving_corner_at(const struct unpacked_moving_triangle *triangle, int k,
                                            struct motion_weights at)
{
    return _mm_add_ps(_mm_mul_ps(_mm_loadu_ps(triangle->start[k]), _mm_set1_ps(at.start)),
                      _mm_mul_ps(_mm_loadu_ps(triangle->end[k]), _mm_set1_ps(at.end)));
}

#endif
#endif
