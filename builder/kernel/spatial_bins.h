/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spatial_bins.h - the kernels of spatial splits (Stich 2009): sort the parts of triangles between equidistant planes
 * into bins along those axes that the grid leaves, choose the cheapest plane, cut by it. Beside bins.h, which sorts
 * whole refs by their centroids.
 *
 * Magnitudes are at most 2^40 (rescale.h). Results depend on the refs, their order and nothing else.
 */
#ifndef BVHD_SPATIAL_BINS_H
#define BVHD_SPATIAL_BINS_H

#include <stdatomic.h>

#include "builder/kernel/bins.h"
#include "builder/kernel/clip.h"

/*
 * A triangle is cut at each plane that it crosses: eight would take a twentieth less of a build, and lose up to three
 * hundredths of the rays' work.
 */
enum { SPATIAL_BINS = 16 };

/* Where the planes are: planes[axis][k] is between bins k - 1 and k. */
struct spatial_grid {
    float planes[3][SPATIAL_BINS];
    float scale[3]; /* bins per length; 0 on an axis too short for different planes */
    float base[3];
};

/* Parts in a bin, grown by boxes; how many refs begin and end in it. */
struct spatial_bins {
    struct vec4_box boxes[3][SPATIAL_BINS]; /* by axis */
    uint32_t begins[3][SPATIAL_BINS], ends[3][SPATIAL_BINS];
};

/* Refs that begin below the plane go left, those that end above it go right; so some go to both sides, cut in two. */
struct spatial_plane {
    unsigned axis;
    uint32_t bin; /* planes[axis][bin] */
    float cost; /* half areas times counts */
    uint32_t left_count, right_count;
    struct vec4_box left, right; /* of the refs' parts */
    bool cut_all; /* none that crosses the plane is left whole; heeded by spatial_assign alone */
};

/* A set of refs on one side of a plane. */
struct spatial_side {
    struct vec4_box bounds, centroids; /* as bins_bound */
    uint32_t count; /* >= 1 */
};

void spatial_grid_lay(const struct vec4_box *bounds, struct spatial_grid *ret_grid);
/*
 * Leaves planes across `axis` and across the longest one, on which nearly all cuts are made: what is not tried takes no
 * time.
 */
void spatial_grid_narrow(const struct vec4_box *bounds, unsigned axis, struct spatial_grid *grid);

void spatial_bins_clear(struct spatial_bins *bins);
/* False when *cancel was set on the way (`cancel` may be NULL). */
bool spatial_bins_add(struct spatial_bins *bins, const struct canonical *canonical, const struct spatial_grid *grid,
                      const struct primitive_ref *refs, uint32_t count, const atomic_bool *cancel);
void spatial_bins_merge(struct spatial_bins *bins, const struct spatial_bins *other);

/*
 * The cheapest plane with something on both sides, and at most `most` refs on both together; false when there is none.
 */
bool spatial_bins_choose(const struct spatial_bins *bins, const struct spatial_grid *grid, uint32_t most,
                         struct spatial_plane *ret_plane);

/*
 * What a ref more has to save, in half areas times counts, so that room and time go where they save most: in proportion
 * to what a ref costs on average. Of `count` refs whose half areas are `areas` together, in a structure of half the
 * area `whole`.
 */
float spatial_price(double areas, float whole, uint32_t count);

/*
 * Whether a cut may pay where the best division of a node's `count` whole refs is `plane`, with room for `slack` refs
 * more: asked first, since looking for one costs as much as all else together. Whether the cut that was found does.
 */
bool spatial_worth_a_try(const struct bins_plane *plane, uint32_t count, uint32_t slack, float price);
bool spatial_is_better(const struct spatial_plane *cut, const struct bins_plane *plane, uint32_t count, float price);

/*
 * What of a node's room for `capacity` refs its left child gets: beyond their refs, by areas times counts, by which
 * they count in the cost.
 */
uint32_t spatial_share_room(uint32_t capacity, const struct spatial_side sides[2]);

/*
 * Copies the refs, or their parts, to both sides: from `left` upwards, from `right` downwards (right[-1] first). A ref
 * that is cheaper whole on one side than cut goes there. Each side gets at most the plane's count, and at least one.
 */
void spatial_partition(const struct canonical *canonical, const struct spatial_grid *grid,
                       const struct spatial_plane *plane, const struct primitive_ref *refs, uint32_t count,
                       struct primitive_ref *left, struct primitive_ref *right, struct spatial_side ret_sides[2]);

/* The side of a ref that is cut, where others have 0 (left) or 1 (right). */
enum { SPATIAL_BOTH = 2 };

/*
 * The same for a part of a node's refs, in two steps: where each goes, and how many to each side; then to `left` and
 * `right` upwards. A ref is left whole by what the plane expects of the sides, so that one may be left without any.
 */
void spatial_assign(const struct spatial_grid *grid, const struct spatial_plane *plane,
                    const struct primitive_ref *refs, uint32_t count, uint8_t *ret_sides, uint32_t ret_counts[2]);
void spatial_send(const struct canonical *canonical, const struct spatial_grid *grid, const struct spatial_plane *plane,
                  const struct primitive_ref *refs, const uint8_t *sides, uint32_t count, struct primitive_ref *left,
                  struct primitive_ref *right, struct spatial_side ret_sides[2]);

#endif
