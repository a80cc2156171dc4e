/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spatial_bins.h - the kernels of spatial splits (Stich 2009): they sort the parts of triangles between equidistant
 * planes into bins, along the axes that the grid uses, choose the cheapest plane, and cut the refs by it. bins.h, in
 * contrast, sorts whole refs by their centroids.
 *
 * Magnitudes are at most 2^40 (rescale.h). Results depend only on the refs and their order. All functions may run on
 * any thread and allocate nothing.
 */
#ifndef BVHD_SPATIAL_BINS_H
#define BVHD_SPATIAL_BINS_H

#include <stdatomic.h>

#include "builder/kernel/bins.h"
#include "builder/kernel/clip.h"

/*
 * Number of bins along an axis. A triangle is cut at each plane that it crosses; eight bins would make a build about
 * 5 % faster, and rays up to 3 % slower.
 */
enum { SPATIAL_BINS = 16 };

/* The planes: planes[axis][k] lies between bins k - 1 and k. */
struct spatial_grid {
    float planes[3][SPATIAL_BINS];
    float scale[3]; /* bins per unit of length; 0 on an axis that is not used, or too short for distinct planes */
    float base[3];
};

/* The contents of the bins: boxes of the parts in each one, and how many refs begin and end in it. */
struct spatial_bins {
    struct vec4_box boxes[3][SPATIAL_BINS]; /* by axis */
    uint32_t begins[3][SPATIAL_BINS], ends[3][SPATIAL_BINS];
};

/*
 * A plane that cuts: refs that begin below it go left, refs that end above it go right, so some go to both sides in two
 * parts.
 */
struct spatial_plane {
    unsigned axis;
    uint32_t bin; /* the plane is planes[axis][bin] */
    float cost; /* half area times count, summed over both sides */
    uint32_t left_count, right_count;
    struct vec4_box left, right; /* boxes of the refs' parts on each side */
    /* every ref that crosses the plane is cut, even if it is cheaper whole; only spatial_assign reads this */
    bool cut_all;
};

/* The refs on one side of a plane. */
struct spatial_side {
    struct vec4_box bounds, centroids; /* as bins_bound computes them */
    uint32_t count; /* >= 1 */
};

/* Lays SPATIAL_BINS - 1 equidistant planes across each axis of the bounds. */
void spatial_grid_lay(const struct vec4_box *bounds, struct spatial_grid *ret_grid);
/*
 * Keeps only the planes across `axis` and across the longest axis, on which nearly all cuts are made, to save the time
 * for the others.
 */
void spatial_grid_narrow(const struct vec4_box *bounds, unsigned axis, struct spatial_grid *grid);

/* Empties the bins. */
void spatial_bins_clear(struct spatial_bins *bins);
/* Adds the parts of `count` refs. Returns false when *cancel was set meanwhile; `cancel` may be NULL. */
bool spatial_bins_add(struct spatial_bins *bins, const struct canonical *canonical, const struct spatial_grid *grid,
                      const struct primitive_ref *refs, uint32_t count, const atomic_bool *cancel);
/* Adds the contents of other bins, which have the same grid. */
void spatial_bins_merge(struct spatial_bins *bins, const struct spatial_bins *other);

/*
 * Chooses the plane of least cost that has something on both sides, and at most `most` refs on both together. Returns
 * false when there is none.
 */
bool spatial_bins_choose(const struct spatial_bins *bins, const struct spatial_grid *grid, uint32_t most,
                         struct spatial_plane *ret_plane);

/*
 * Returns the price of an additional ref: how much SAH cost (half areas times counts) a split has to save for each ref
 * that it adds. One price holds for the whole structure, so room and time go to the splits that save most. It is
 * proportional to sqrt(areas * whole) / count, where `areas` is the sum of the half areas of the structure's `count`
 * refs, and `whole` the half area of the structure.
 */
float spatial_price(double areas, float whole, uint32_t count);

/*
 * spatial_worth_a_try: true when a spatial split may pay in a node of `count` refs with room for `slack` more; `plane`
 * is the best division of the node that cuts no ref. Call it first, because finding a spatial split costs as much as
 * all the rest of the node. spatial_is_better: true when the spatial split that was found does pay.
 */
bool spatial_worth_a_try(const struct bins_plane *plane, uint32_t count, uint32_t slack, float price);
bool spatial_is_better(const struct spatial_plane *cut, const struct bins_plane *plane, uint32_t count, float price);

/*
 * Returns how much of a node's room for `capacity` refs its left child gets: the room beyond the refs is shared in
 * proportion to area times count, which is what the sides cost.
 */
uint32_t spatial_share_room(uint32_t capacity, const struct spatial_side sides[2]);

/*
 * Copies the refs, or their parts, to both sides: from `left` upwards, and from `right` downwards (the first to
 * right[-1]). A ref that is cheaper whole on one side than cut goes there as a whole. Each side gets at most the
 * plane's count, and at least one.
 */
void spatial_partition(const struct canonical *canonical, const struct spatial_grid *grid,
                       const struct spatial_plane *plane, const struct primitive_ref *refs, uint32_t count,
                       struct primitive_ref *left, struct primitive_ref *right, struct spatial_side ret_sides[2]);

/* Value of a ref that is cut, in spatial_assign's array, where the others have 0 (left) or 1 (right). */
enum { SPATIAL_BOTH = 2 };

/*
 * Do the same for some of a node's refs, in two steps, so that several threads can share a node. spatial_assign decides
 * where each ref goes and counts both sides; spatial_send copies them to `left` and `right`, upwards. Whether a ref
 * stays whole is decided by the boxes and counts of the plane's sides as spatial_bins_choose found them, not by the
 * refs seen so far, so one side may get no refs.
 */
void spatial_assign(const struct spatial_grid *grid, const struct spatial_plane *plane,
                    const struct primitive_ref *refs, uint32_t count, uint8_t *ret_sides, uint32_t ret_counts[2]);
void spatial_send(const struct canonical *canonical, const struct spatial_grid *grid, const struct spatial_plane *plane,
                  const struct primitive_ref *refs, const uint8_t *sides, uint32_t count, struct primitive_ref *left,
                  struct primitive_ref *right, struct spatial_side ret_sides[2]);

#endif
