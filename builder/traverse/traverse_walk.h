/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_walk.h - the state of one ray in portable structures, which traverse.c and the loops of traverse_loops.c
 * share. Internal.
 *
 * Levels nest by calls: the loop over a top level calls, for each instance that it meets, the loop over that bottom
 * level. Each level has its own stack in its frame, whose size suffices because portable_open limits the depth.
 */
#ifndef BVHD_TRAVERSE_WALK_H
#define BVHD_TRAVERSE_WALK_H

#include "builder/traverse/traverse_state.h"

/* One ray in portable structures. */
struct traverse_walk {
    struct traverse_state state; /* first, because identify() casts it back to the walk */
    const struct scene *scene;
    const struct portable_view *view; /* of the level that is being traversed */
    const struct unpacked_node *unpacked; /* its nodes, if it is an unpacked bottom level */
    bool in_world; /* the ray is in world space, exactly as the caller gave it */
    bool avx2; /* the machine has AVX2, and the caller does not forbid it */
    float matrix[12]; /* of a motion instance at the ray's time, while the ray is in it */
};

/* Finds the geometry and the primitive of an id in a bottom level; the state is that of a walk. */
void traverse_walk_identify(const struct traverse_state *state, uint32_t bottom, uint64_t id, uint32_t *ret_geometry,
                            uint32_t *ret_primitive);

/* Gives a walk its scene. */
static inline void traverse_walk_begin(struct traverse_walk *walk, const struct scene *scene)
{
    walk->state.identify = traverse_walk_identify;
    walk->scene = scene;
}

/* Traces a walk through one of the scene's bottoms, whose instance is NULL if there is no top level. */
void traverse_walk_bottom(struct traverse_walk *walk, uint32_t bottom, const struct traverse_instance *instance);

/* Trace a walk through the instance in a row of the top level's records, for the two kinds of top levels. */
void traverse_walk_instance(struct traverse_walk *walk, uint32_t row);
void traverse_walk_moving_instance(struct traverse_walk *walk, uint32_t row);

/* Processes the records of a leaf that the ray reached. */
typedef void (*traverse_leaf)(struct traverse_walk *walk, uint32_t first, uint32_t count);

/* The loops over nodes, by kind of box test (traverse_loops.c). */
void traverse_loop_float(struct traverse_walk *walk, const struct boxtest_ray *ray, traverse_leaf leaf);
void traverse_loop_avx2(struct traverse_walk *walk, const struct boxtest_ray *ray, traverse_leaf leaf);
void traverse_loop_double(struct traverse_walk *walk, const struct boxtest_exact *ray, traverse_leaf leaf);

/* The same over moving nodes. */
struct boxtest_moving;
struct boxtest_moving_exact;
void traverse_loop_moving_float(struct traverse_walk *walk, const struct boxtest_moving *ray, traverse_leaf leaf);
void traverse_loop_moving_avx2(struct traverse_walk *walk, const struct boxtest_moving *ray, traverse_leaf leaf);
void traverse_loop_moving_double(struct traverse_walk *walk, const struct boxtest_moving_exact *ray,
                                 traverse_leaf leaf);

/*
 * Traverse a non-empty bottom level of triangles with AVX2 (traverse_avx2.c), on machines for which boxtest_has_avx2()
 * is true. The state is ready for its primitives; for _world the triangle_ray is missing and the ray is in world space.
 * They return false, and do nothing, if boxes have to be tested in another way.
 */
bool traverse_avx2_triangles(struct traverse_state *state, const struct portable_view *view,
                             const struct unpacked_node *unpacked);
bool traverse_avx2_world(struct traverse_state *state, const struct portable_view *view,
                         const struct unpacked_node *unpacked);

/*
 * Does the same as traverse_avx2_world() for a plain ray and an unpacked structure of stored triangles, with less
 * preparation.
 */
bool traverse_avx2_plain(struct traverse_state *state, const struct portable_view *view,
                         const struct unpacked_node *unpacked);

/*
 * Finds any hit in a non-empty top level in world space with AVX2: the leaves of a node first, then its inner children
 * farthest along the ray's octant, which is an order that packets can have, too.
 */
void traverse_avx2_any_instances(struct traverse_walk *walk, const struct boxtest_ray *ray, traverse_leaf leaf);
void traverse_avx2_any_moving_instances(struct traverse_walk *walk, const struct boxtest_moving *ray,
                                        traverse_leaf leaf);

/* Find the corners of a triangle record and return its id: for indexed triangles, for stored ones, for either. */
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
