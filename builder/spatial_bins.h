/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spatial_bins.h - the kernels of spatial splits (Stich 2009): sort the parts of triangles between equidistant planes into bins along all three
 * axes, choose the cheapest plane, cut by it. Beside bins.h, which sorts whole refs by their centroids.
 *
 * Magnitudes are at most 2^40 (rescale.h). Results depend on the refs, their order and nothing else.
 */
#ifndef BVHD_SPATIAL_BINS_H
#define BVHD_SPATIAL_BINS_H

#include <stdatomic.h>

#include "clip.h"

enum { SPATIAL_BINS_MAX = 16 };

/* Where the planes are: planes[axis][k] is between bins k - 1 and k. */
struct spatial_grid {
    float planes[3][SPATIAL_BINS_MAX];
    float scale[3]; /* bins per length; 0 on an axis too short for different planes */
    float base[3];
    uint32_t bins; /* at most SPATIAL_BINS_MAX */
};

/* Refs that begin below the plane go left, those that end above it go right; so some go to both sides, cut in two. */
struct spatial_plane {
    unsigned axis;
    uint32_t bin; /* planes[axis][bin] */
    float cost; /* half areas times counts */
    uint32_t left_count, right_count;
    struct vec4_box left, right; /* of the refs' parts */
};

/* A set of refs on one side of a plane. */
struct spatial_side {
    struct vec4_box bounds, centroids; /* as bins_bound */
    uint32_t count; /* >= 1 */
};

void spatial_grid_lay(const struct vec4_box *bounds, uint32_t count, struct spatial_grid *ret_grid);

/*
 * The cheapest plane with something on both sides that makes at most `slack` refs more; false when there is none, or when *cancel is set on the
 * way (`cancel` may be NULL).
 */
bool spatial_choose(const struct canonical *canonical, const struct spatial_grid *grid, const struct primitive_ref *refs,
                    uint32_t count, uint32_t slack, const atomic_bool *cancel, struct spatial_plane *ret_plane);

/*
 * Copies the refs, or their parts, to both sides: from `left` upwards, from `right` downwards (right[-1] first). A ref that is cheaper whole on one
 * side than cut goes there. Each side gets at most the plane's count, and at least one.
 */
void spatial_partition(const struct canonical *canonical, const struct spatial_grid *grid, const struct spatial_plane *plane,
                       const struct primitive_ref *refs, uint32_t count, struct primitive_ref *left, struct primitive_ref *right,
                       struct spatial_side ret_sides[2]);

#endif
