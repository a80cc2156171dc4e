/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_walk.h - a ray on its way through portable structures: what traverse.c and the loops of traverse_loops.c
 * share. Internal.
 *
 * Levels nest by calls: the loop over a top level calls, for each instance that it meets, the loop over that bottom
 * level. Each level has a stack of its own in its frame, of a size that portable_open's limit on depth makes enough.
 */
#ifndef BVHD_TRAVERSE_WALK_H
#define BVHD_TRAVERSE_WALK_H

#include "builder/traverse/traverse_state.h"

struct traverse_walk {
    struct traverse_state state; /* first: its identify() gets back to the walk */
    const struct scene *scene;
    const struct portable_view *view; /* of the level that is being traversed */
    bool in_world; /* the ray is in world space, still as it was given */
    bool avx2; /* this machine can, and the caller does not forbid it */
};

/* What to do with the records of a leaf that the ray reached. */
typedef void (*traverse_leaf)(struct traverse_walk *walk, uint32_t first, uint32_t count);

/* traverse_loops.c: the loops over nodes, by kind of box test. */
void traverse_loop_float(struct traverse_walk *walk, const struct boxtest_ray *ray, traverse_leaf leaf);
void traverse_loop_avx2(struct traverse_walk *walk, const struct boxtest_ray *ray, traverse_leaf leaf);
void traverse_loop_double(struct traverse_walk *walk, const struct boxtest_exact *ray, traverse_leaf leaf);

/*
 * traverse_avx2.c: a bottom level of triangles, which is not empty, on machines for which boxtest_has_avx2(). The state
 * is ready for its primitives; for _world but for the triangle_ray, and the ray is in world space. False: boxes have to
 * be tested otherwise, and nothing has been done.
 */
bool traverse_avx2_triangles(struct traverse_state *state, const struct portable_view *view);
bool traverse_avx2_world(struct traverse_state *state, const struct portable_view *view);

/* The corners of a triangle record, and its id: of indexed triangles, of stored ones, of either. */
static inline uint32_t traverse_corners_indexed(const struct portable_view *view, uint32_t record,
                                                const float *ret_corners[3])
{
    const struct portable_indexed_triangle *triangle = (const struct portable_indexed_triangle *)view->records + record;
    for (int k = 0; k < 3; k++)
        ret_corners[k] = view->vertices + (uint64_t)3 * triangle->vertices[k];
    return triangle->id;
}

static inline uint32_t traverse_corners_stored(const struct portable_view *view, uint32_t record,
                                               const float *ret_corners[3])
{
    const struct portable_triangle *triangle = (const struct portable_triangle *)view->records + record;
    ret_corners[0] = triangle->v0;
    ret_corners[1] = triangle->v1;
    ret_corners[2] = triangle->v2;
    return triangle->id;
}

static inline uint32_t traverse_corners(const struct portable_view *view, uint32_t record, const float *ret_corners[3])
{
    bool is_stored = view->header->content == PORTABLE_TRIANGLES;
    return (is_stored ? traverse_corners_stored : traverse_corners_indexed)(view, record, ret_corners);
}

#endif
