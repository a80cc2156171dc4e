/* SPDX-License-Identifier: Apache-2.0 */
/*
 * leaf_kind.h - what a ray does at the leaves of a portable structure: one row for each content, in a file for each
 * kind of record, such as leaf_triangles.c. Internal.
 */
#ifndef BVHD_LEAF_KIND_H
#define BVHD_LEAF_KIND_H

#include "builder/traverse/traverse_walk.h"

/* The leaves of the structures with one content. */
struct leaf_kind {
    uint32_t skip_flag; /* the RAY_SKIP_ flag of rays that skip the primitives; 0: these are instances */
    bool is_top; /* they hold instances, so that the structure is a top level */
    bool is_triangles; /* they hold triangles, which rays meet with a triangle_ray, and whose facing counts */
    bool moves; /* nodes are struct portable_moving_node */
    /* Prepares the state for visit(). NULL: there is nothing to prepare, or is_triangles says it. */
    void (*prepare)(struct traverse_state *state);
    bool can_unpack; /* unpacked_fill() takes such structures */
    bool unpacks_few; /* single rays use the unpacked nodes of small structures only */
    uint32_t shape_floats; /* of what unpacked_fill() copies for each record (unpacked_shapes()) */
    bool has_packets; /* packet_avx2.c walks through a structure that is unpacked, */
    bool packs_any; /* and rays that search any hit take less time so */
    traverse_leaf visit;

    /* A faster walk for machines with AVX2, which returns false if the general one is needed. NULL: there is none. */
    bool (*walk_avx2)(struct traverse_state *state, const struct portable_view *view,
                      const struct unpacked_node *unpacked);
    /* The same for rays in world space of which the state has neither the ray nor its triangle_ray. NULL: none. */
    bool (*walk_world)(struct traverse_state *state, const struct portable_view *view,
                       const struct unpacked_node *unpacked);
    /*
     * The same with less preparation, for plain rays in world space through an unpacked structure alone, whose state
     * traverse_state_settle_plain() has settled. NULL: there is none.
     */
    traverse_plain walk_plain;
    /* Grows a box by the records. NULL: they do not tell their boxes, so that those in nodes are the tightest. */
    void (*grow)(const struct portable_view *view, uint32_t first, uint32_t count, struct box *box);
};

extern const struct leaf_kind leaf_triangles, leaf_aabbs, leaf_instances, leaf_spheres, leaf_swept_spheres,
    leaf_moving_triangles, leaf_moving_instances;

/*
 * Traverses a structure of motion triangles (moving_avx2.c) whose `unpacked` is the first of its unpacked moving nodes.
 * Returns false, and does nothing, if the general walk is needed, as it is if `unpacked` is NULL.
 */
bool traverse_avx2_moving(struct traverse_state *state, const struct portable_view *view,
                          const struct unpacked_node *unpacked);
bool traverse_avx2_moving_world(struct traverse_state *state, const struct portable_view *view,
                                const struct unpacked_node *unpacked);

/* The rows by enum portable_content. */
extern const struct leaf_kind *const leaf_kinds[PORTABLE_CONTENTS];

/* Returns the row of an opened structure. */
static inline const struct leaf_kind *leaf_kind_of(const struct portable_view *view)
{
    return leaf_kinds[view->header->content];
}

#endif
