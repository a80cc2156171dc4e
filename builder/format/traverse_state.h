/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_state.h - one ray on its way: what traverse.c, traverse_leaf.c and the loops of traverse_loops.c share. Internal.
 *
 * Levels nest by calls: the loop over a top level calls, for each instance that it meets, the loop over that bottom level. Each level has a
 * stack of its own in its frame, of a size that portable_open's limit on depth makes enough.
 */
#ifndef BVHD_TRAVERSE_STATE_H
#define BVHD_TRAVERSE_STATE_H

#include "boxtest.h"
#include "traverse.h"
#include "triangle.h"

/* Something that was hit, or may be. */
struct traverse_found {
    double t, u, v;
    const struct portable_view *view; /* the bottom level that it lies in */
    const struct portable_instance *instance; /* NULL without a top level */
    uint32_t id; /* of its record */
    uint32_t record;
    bool front_face, is_aabb;
};

/* Whether primitives count as opaque. */
enum traverse_opacity { OPACITY_AS_BUILT, OPACITY_OPAQUE, OPACITY_NO_OPAQUE };

struct traverse_state {
    const struct scene *scene;
    const struct ray *ray;
    const struct traverse_options *options; /* never NULL */
    struct traverse_counters counters;
    bool wide; /* this machine can, and the caller does not forbid it */

    /* What is of interest ends here: the closest hit so far, else the ray's tmax. */
    double tmax;
    float tmax_above; /* rounded up */
    bool is_hit, is_done;
    struct traverse_found best;

    /* The bottom level that is being traversed, and the ray in its space. */
    const struct portable_view *view;
    const struct portable_instance *instance;
    bool cull_front, cull_back;
    enum traverse_opacity opacity;
    double origin[3], direction[3];
    struct triangle_ray triangle_ray;
};

/* What to do with the records of a leaf that the ray reached. */
typedef void (*traverse_leaf)(struct traverse_state *state, uint32_t first, uint32_t count);

/* traverse.c: goes through state->view with the ray in state->origin, state->direction. */
void traverse_level(struct traverse_state *state, traverse_leaf leaf);

/* traverse_leaf.c: leaves by content. */
void traverse_leaf_triangles(struct traverse_state *state, uint32_t first, uint32_t count);
void traverse_leaf_aabbs(struct traverse_state *state, uint32_t first, uint32_t count);

/* traverse_leaf.c: one triangle, in double: the end of what traverse_leaf_triangles does. */
void traverse_leaf_triangle(struct traverse_state *state, uint32_t record, uint32_t id, const float *const corners[3]);

/* traverse_leaf.c: the answer in the caller's terms. */
void traverse_leaf_describe(const struct traverse_found *found, struct ray_hit *ret_hit);

/* traverse_loops.c: the loops over nodes, by kind of box test. loop_wide_triangles brings its own leaves. */
void traverse_loop_float(struct traverse_state *state, const struct boxtest_ray *ray, traverse_leaf leaf);
void traverse_loop_wide(struct traverse_state *state, const struct boxtest_ray *ray, traverse_leaf leaf);
void traverse_loop_wide_triangles(struct traverse_state *state, const struct boxtest_ray *ray, traverse_leaf leaf);
void traverse_loop_double(struct traverse_state *state, const struct boxtest_exact *ray, traverse_leaf leaf);

/* The corners of a triangle record, and its id. */
static inline uint32_t traverse_corners(const struct portable_view *view, uint32_t record, const float *ret_corners[3])
{
    if (view->header->content == PORTABLE_TRIANGLES) {
        const struct portable_triangle *triangle = (const struct portable_triangle *)view->records + record;
        ret_corners[0] = triangle->v0;
        ret_corners[1] = triangle->v1;
        ret_corners[2] = triangle->v2;
        return triangle->id;
    }
    const struct portable_indexed_triangle *triangle = (const struct portable_indexed_triangle *)view->records + record;
    for (int k = 0; k < 3; k++)
        ret_corners[k] = view->vertices + (uint64_t)3 * triangle->vertices[k];
    return triangle->id;
}

#endif
