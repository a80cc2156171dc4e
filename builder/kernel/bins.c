/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/kernel/bins.h"

#include <math.h>

#include "builder/kernel/bins_kernels.h"

/* Evaluating a plane costs as much as binning several refs, so few refs get few planes. */
static uint32_t bins_for(uint32_t count)
{
    uint32_t bins = 4 + count / 16;
    return bins < BINS_MAX ? bins : BINS_MAX;
}

void bins_bound(const struct primitive_ref *refs, uint32_t count, struct vec4_box *ret_bounds,
                struct vec4_box *ret_centroids)
{
    struct vec4_box bounds = vec4_box_empty(), centroids = vec4_box_empty();
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]);
        vec4 centroid = box.min + box.max;
        vec4_box_grow(&bounds, box.min, box.max);
        vec4_box_grow(&centroids, centroid, centroid);
    }
    *ret_bounds = bounds;
    *ret_centroids = centroids;
}

static inline void add_centroid(struct vec4_box *centroids, const struct primitive_ref *ref)
{
    const struct vec4_box box = vec4_box_load(ref);
    const vec4 centroid = box.min + box.max;
    vec4_box_grow(centroids, centroid, centroid);
}

/* Grows two boxes alternately, because each operation waits for the one before on the same box. */
struct vec4_box bins_centroids(const struct primitive_ref *refs, uint32_t count)
{
    struct vec4_box even = vec4_box_empty(), odd = vec4_box_empty();
    for (uint32_t i = 0; i < count; i += 2) {
        add_centroid(&even, &refs[i]);
        add_centroid(&odd, &refs[count - i > 1 ? i + 1 : i]);
    }
    vec4_box_grow(&even, odd.min, odd.max);
    return even;
}

void bins_map(const struct vec4_box *centroids, uint32_t count, struct bins_mapping *ret_mapping)
{
    ret_mapping->bins = bins_for(count);
    /* The scale is a little less than the number of bins, so that the largest centroid falls into the last bin. */
    vec4 scale = vec4_all((float)ret_mapping->bins - 0.01f) / vec4_xyz(centroids->max - centroids->min);
    ret_mapping->base = centroids->min;
    ret_mapping->scale = vec4_xyz(vec4_and(scale, (scale > vec4_all(0)) & (scale <= vec4_all(FLT_MAX))));
}

/* Grows a box whose maximum is negated. */
static inline void grow(struct vec4_box *box, const struct vec4_box *bin)
{
    box->min = vec4_min(bin->min, box->min);
    box->max = vec4_min(bin->max, box->max);
}

static inline struct vec4_box nothing(void)
{
    return (struct vec4_box){vec4_all(FLT_MAX), vec4_all(FLT_MAX)};
}

static const struct bins_kernels *kernels(void)
{
    const struct bins_kernels *best = bins_kernels_avx2();
    return best ? best : &bins_kernels_plain;
}

void bins_clear(struct bins *bins, const struct bins_mapping *mapping)
{
    kernels()->clear(bins, mapping);
}

void bins_add(struct bins *bins, const struct bins_mapping *mapping, const struct primitive_ref *refs, uint32_t count)
{
    enum { TWO_SETS_FROM = 1024 };
    struct bins *sets[2] = {bins, bins}, other;
    /*
     * Neighbours tend to fall into the same bin, where each update waits for the one before. With two sets only every
     * second ref goes to the same box.
     */
    if (count >= TWO_SETS_FROM) {
        sets[1] = &other;
        bins_clear(&other, mapping);
    }
    kernels()->add(sets, mapping, refs, count);
    if (count >= TWO_SETS_FROM)
        bins_merge(bins, mapping, &other);
}

void bins_partition(const struct bins_mapping *mapping, const struct bins_plane *plane,
                    const struct primitive_ref *refs, uint32_t count, struct primitive_ref *left,
                    struct primitive_ref *right, struct vec4_box ret_centroids[2])
{
    kernels()->partition(mapping, plane, refs, count, left, right, ret_centroids);
}

void bins_merge(struct bins *bins, const struct bins_mapping *mapping, const struct bins *other)
{
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t bin = 0; bin < mapping->bins; bin++)
            grow(&bins->boxes[axis][bin], &other->boxes[axis][bin]);
    for (uint32_t bin = 0; bin < mapping->bins; bin++)
        bins->counts[bin] += other->counts[bin];
}

/*
 * Grows three boxes, one for each axis, by the boxes of a bin, and returns their half areas. Sides come out negated,
 * which does not change the products.
 */
static inline vec4 grow_all(struct vec4_box boxes[3], const struct bins *bins, uint32_t bin)
{
    vec4 x, y, z;
    for (int axis = 0; axis < 3; axis++)
        grow(&boxes[axis], &bins->boxes[axis][bin]);
    vec4_transpose3(boxes[0].min + boxes[0].max, boxes[1].min + boxes[1].max, boxes[2].min + boxes[2].max, &x, &y, &z);
    return x * y + y * z + z * x;
}

/* The best plane of each axis, one lane for each axis. */
struct candidates {
    vec4 cost;
    vec4 larger; /* number of refs on the larger side */
    vec4 bin; /* 0 when there is none */
};

/* When one side is empty its area is infinite and its count 0, so the cost is NaN and the plane is never chosen. */
static struct candidates find_candidates(const struct bins *bins, const struct bins_mapping *mapping, uint32_t count)
{
    vec4 right_costs[BINS_MAX], right_counts[BINS_MAX];
    struct vec4_box boxes[3] = {nothing(), nothing(), nothing()};
    vec4_int sum = {0};
    for (uint32_t bin = mapping->bins - 1; bin > 0; bin--) {
        sum += bins->counts[bin];
        right_counts[bin] = __builtin_convertvector(sum, vec4);
        right_costs[bin] = grow_all(boxes, bins, bin) * right_counts[bin];
    }
    struct candidates best = {vec4_all(INFINITY), vec4_all(INFINITY), vec4_all(0)};
    boxes[0] = boxes[1] = boxes[2] = nothing();
    for (uint32_t bin = 1; bin < mapping->bins; bin++) {
        vec4 left_count = vec4_all((float)count) - right_counts[bin];
        vec4 cost = grow_all(boxes, bins, bin - 1) * left_count + right_costs[bin];
        vec4 larger = vec4_max(left_count, right_counts[bin]);
        vec4_int better = (cost < best.cost) | ((cost == best.cost) & (larger < best.larger));
        best.cost = vec4_select(better, cost, best.cost);
        best.larger = vec4_select(better, larger, best.larger);
        best.bin = vec4_select(better, vec4_all((float)bin), best.bin);
    }
    return best;
}

bool bins_choose(const struct bins *bins, const struct bins_mapping *mapping, uint32_t count,
                 struct bins_plane *ret_plane)
{
    struct candidates found = find_candidates(bins, mapping, count);
    int best = 0;
    for (int axis = 1; axis < 3; axis++)
        if (found.cost[axis] < found.cost[best] ||
            (found.cost[axis] == found.cost[best] && found.larger[axis] < found.larger[best]))
            best = axis;
    if (found.bin[best] == 0)
        return false;
    struct vec4_box sides[2] = {nothing(), nothing()};
    uint32_t bin = 0;
    ret_plane->axis = (unsigned)best;
    ret_plane->bin = (uint32_t)found.bin[best];
    for (; bin < ret_plane->bin; bin++)
        grow(&sides[0], &bins->boxes[best][bin]);
    for (; bin < mapping->bins; bin++)
        grow(&sides[1], &bins->boxes[best][bin]);
    ret_plane->left_count = bins_left_count(bins, ret_plane);
    ret_plane->left = (struct vec4_box){sides[0].min, -sides[0].max};
    ret_plane->right = (struct vec4_box){sides[1].min, -sides[1].max};
    return true;
}

bool bins_find(const struct primitive_ref *refs, uint32_t count, const struct vec4_box *centroids,
               struct bins_mapping *ret_mapping, struct bins_plane *ret_plane)
{
    struct bins bins;
    bins_map(centroids, count, ret_mapping);
    bins_clear(&bins, ret_mapping);
    bins_add(&bins, ret_mapping, refs, count);
    return bins_choose(&bins, ret_mapping, count, ret_plane);
}

void bins_halve(const struct primitive_ref *refs, uint32_t count, struct bins_plane *ret_plane,
                struct vec4_box ret_centroids[2])
{
    ret_plane->left_count = count / 2;
    bins_bound(refs, count / 2, &ret_plane->left, &ret_centroids[0]);
    bins_bound(refs + count / 2, count - count / 2, &ret_plane->right, &ret_centroids[1]);
}

uint32_t bins_left_count(const struct bins *bins, const struct bins_plane *plane)
{
    vec4_int sum = {0};
    for (uint32_t bin = 0; bin < plane->bin; bin++)
        sum += bins->counts[bin];
    return (uint32_t)sum[plane->axis];
}
