/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bins.h - the kernels of binned SAH (Wald 2007): sort refs into bins by their centroids along all three axes, choose
 * the cheapest plane between bins, partition by it. For split.c, which works on many chunks at once, and spatial.c,
 * which goes down to the leaves.
 *
 * Centroids are min + max, twice the centre. Magnitudes are at most 2^40 (rescale.h), so that areas times counts stay
 * in float's range. Results depend on the refs, their order and nothing else. Fourth lanes of boxes are of no meaning.
 */
#ifndef BVHD_BINS_H
#define BVHD_BINS_H

#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

enum { BINS_MAX = 32 };

/* How centroids become bin numbers. */
struct bins_mapping {
    vec4 base, scale; /* bin = (centroid - base) * scale; scale 0 on an axis along which nothing can be separated */
    uint32_t bins; /* at most BINS_MAX; fewer for few refs */
};

/* Of each bin the box's minimum and negated maximum, so that one operation grows both. */
struct bins {
    _Alignas(32) struct vec4_box boxes[3][BINS_MAX]; /* by axis */
    vec4_int counts[BINS_MAX]; /* a lane an axis */
};

/* A plane: refs whose bin on `axis` is below `bin` go left. Both sides get at least one ref. */
struct bins_plane {
    unsigned axis;
    uint32_t bin;
    uint32_t left_count;
    struct vec4_box left, right; /* of the refs */
};

/* Box and centroid box of refs; as primitive_ref_bounds, in registers. */
void bins_bound(const struct primitive_ref *refs, uint32_t count, struct vec4_box *ret_bounds,
                struct vec4_box *ret_centroids);

/* The centroid box alone, in half the time; of zeros on its sides the sign is of no meaning. */
struct vec4_box bins_centroids(const struct primitive_ref *refs, uint32_t count);

void bins_map(const struct vec4_box *centroids, uint32_t count, struct bins_mapping *ret_mapping);

void bins_clear(struct bins *bins, const struct bins_mapping *mapping);
void bins_add(struct bins *bins, const struct bins_mapping *mapping, const struct primitive_ref *refs, uint32_t count);
void bins_merge(struct bins *bins, const struct bins_mapping *mapping, const struct bins *other);

/*
 * The cheapest plane; of equals the one that divides best, then the first of an axis, then the first axis. False when
 * there is none. `count`: of all refs in the bins.
 */
bool bins_choose(const struct bins *bins, const struct bins_mapping *mapping, uint32_t count,
                 struct bins_plane *ret_plane);

/* The plane for refs in one array: as bins_map, bins_add and bins_choose. */
bool bins_find(const struct primitive_ref *refs, uint32_t count, const struct vec4_box *centroids,
               struct bins_mapping *ret_mapping, struct bins_plane *ret_plane);

/* The other way to divide: in the middle of the order as it is. Axis and bin of the plane are not set. */
void bins_halve(const struct primitive_ref *refs, uint32_t count, struct bins_plane *ret_plane,
                struct vec4_box ret_centroids[2]);

uint32_t bins_left_count(const struct bins *bins, const struct bins_plane *plane);

/* Copies the refs to the ends of two arrays, in their order; returns both sides' centroid boxes. */
void bins_partition(const struct bins_mapping *mapping, const struct bins_plane *plane,
                    const struct primitive_ref *refs, uint32_t count, struct primitive_ref *left,
                    struct primitive_ref *right, struct vec4_box ret_centroids[2]);

#endif
