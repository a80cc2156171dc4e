/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bins.h - the kernels of binned SAH (Wald 2007): they sort refs into bins by their centroids along all three axes,
 * choose the cheapest plane between bins, and partition the refs by it. split.c uses them on many chunks at once,
 * binned.c and spatial.c on their way down to the leaves.
 *
 * A centroid is min + max, which is twice the centre. Magnitudes are at most 2^40 (rescale.h), so that areas times
 * counts stay in float's range. Results depend only on the refs and their order. The fourth lanes of boxes have no
 * meaning. All functions may run on any thread; none allocates or fails.
 */
#ifndef BVHD_BINS_H
#define BVHD_BINS_H

#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

enum { BINS_MAX = 32 };

/* The map from centroids to bin numbers. */
struct bins_mapping {
    /* bin = (centroid - base) * scale; scale is 0 on an axis along which nothing can be separated */
    vec4 base, scale;
    uint32_t bins; /* at most BINS_MAX; fewer for few refs */
};

/*
 * The contents of the bins: for each bin the minimum of its box and the negated maximum, so that one operation grows
 * both.
 */
struct bins {
    _Alignas(32) struct vec4_box boxes[3][BINS_MAX]; /* by axis */
    vec4_int counts[BINS_MAX]; /* one lane for each axis */
};

/* A dividing plane: refs whose bin on `axis` is below `bin` go left. Both sides get at least one ref. */
struct bins_plane {
    unsigned axis;
    uint32_t bin;
    uint32_t left_count;
    struct vec4_box left, right; /* boxes of the refs on each side */
};

/* Computes the box of the refs and the box of their centroids, like primitive_ref_bounds, but in registers. */
void bins_bound(const struct primitive_ref *refs, uint32_t count, struct vec4_box *ret_bounds,
                struct vec4_box *ret_centroids);

/* Computes only the box of the centroids, in half the time. A coordinate of the box that is 0 may have either sign. */
struct vec4_box bins_centroids(const struct primitive_ref *refs, uint32_t count);

/* Chooses the map for `count` refs with these centroids. */
void bins_map(const struct vec4_box *centroids, uint32_t count, struct bins_mapping *ret_mapping);

/* Empties the bins; adds refs to them; adds the refs of other bins with the same map. */
void bins_clear(struct bins *bins, const struct bins_mapping *mapping);
void bins_add(struct bins *bins, const struct bins_mapping *mapping, const struct primitive_ref *refs, uint32_t count);
void bins_merge(struct bins *bins, const struct bins_mapping *mapping, const struct bins *other);

/*
 * Chooses the plane of least cost; among equal costs the one that divides most evenly, then the first on its axis, then
 * the first axis. `count`: number of all refs in the bins. Returns false when there is no plane.
 */
bool bins_choose(const struct bins *bins, const struct bins_mapping *mapping, uint32_t count,
                 struct bins_plane *ret_plane);

/* Finds the plane for refs in one array, as bins_map, bins_clear, bins_add and bins_choose together do. */
bool bins_find(const struct primitive_ref *refs, uint32_t count, const struct vec4_box *centroids,
               struct bins_mapping *ret_mapping, struct bins_plane *ret_plane);

/*
 * Divides the refs in the middle of their present order, for use where there is no plane. Does not set the plane's axis
 * and bin.
 */
void bins_halve(const struct primitive_ref *refs, uint32_t count, struct bins_plane *ret_plane,
                struct vec4_box ret_centroids[2]);

/* Returns how many refs the plane sends left. */
uint32_t bins_left_count(const struct bins *bins, const struct bins_plane *plane);

/* Copies the refs in their order to `left` and to `right`, upwards, and returns the centroid boxes of both sides. */
void bins_partition(const struct bins_mapping *mapping, const struct bins_plane *plane,
                    const struct primitive_ref *refs, uint32_t count, struct primitive_ref *left,
                    struct primitive_ref *right, struct vec4_box ret_centroids[2]);

#endif
