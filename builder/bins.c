/* SPDX-License-Identifier: Apache-2.0 */
#include "bins.h"

#include <math.h>

/* Evaluating planes costs as much as binning some refs a plane; where there are few refs, few planes are enough. */
static uint32_t bins_for(uint32_t count)
{
    uint32_t bins = 4 + count / 16;
    return bins < BINS_MAX ? bins : BINS_MAX;
}

void bins_bound(const struct primitive_ref *refs, uint32_t count, struct vec4_box *ret_bounds, struct vec4_box *ret_centroids)
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

void bins_map(const struct vec4_box *centroids, uint32_t count, struct bins_mapping *ret_mapping)
{
    ret_mapping->bins = bins_for(count);
    /* A little less than the number of bins, so that the largest centroid falls into the last one. */
    vec4 scale = vec4_all((float)ret_mapping->bins - 0.01f) / vec4_xyz(centroids->max - centroids->min);
    ret_mapping->base = centroids->min;
    ret_mapping->scale = vec4_xyz(vec4_and(scale, (scale > vec4_all(0)) & (scale <= vec4_all(FLT_MAX))));
}

void bins_clear(struct bins *bins, const struct bins_mapping *mapping)
{
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t bin = 0; bin < mapping->bins; bin++)
            bins->boxes[axis][bin] = vec4_box_empty();
    memset(bins->counts, 0, mapping->bins * sizeof *bins->counts);
}

/* The fourth lanes hold integers that may look like denormals, slow to multiply: they are cleared. */
static inline vec4 place(const struct bins_mapping *mapping, vec4 centroid)
{
    return vec4_xyz(centroid - mapping->base) * mapping->scale;
}

void bins_add(struct bins *bins, const struct bins_mapping *mapping, const struct primitive_ref *refs, uint32_t count)
{
    const struct bins_mapping local = *mapping;
    const vec4 last = vec4_all((float)(local.bins - 1));
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]);
        vec4_int bin = __builtin_convertvector(vec4_min(place(&local, box.min + box.max), last), vec4_int);
        for (int axis = 0; axis < 3; axis++) {
            vec4_box_grow(&bins->boxes[axis][bin[axis]], box.min, box.max);
            bins->counts[bin[axis]][axis]++;
        }
    }
}

void bins_merge(struct bins *bins, const struct bins_mapping *mapping, const struct bins *other)
{
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t bin = 0; bin < mapping->bins; bin++)
            vec4_box_grow(&bins->boxes[axis][bin], other->boxes[axis][bin].min, other->boxes[axis][bin].max);
    for (uint32_t bin = 0; bin < mapping->bins; bin++)
        bins->counts[bin] += other->counts[bin];
}

/* Grows three boxes, one an axis, by those of a bin, and returns their half areas. */
static inline vec4 grow_all(struct vec4_box boxes[3], const struct bins *bins, uint32_t bin)
{
    vec4 x, y, z;
    for (int axis = 0; axis < 3; axis++)
        vec4_box_grow(&boxes[axis], bins->boxes[axis][bin].min, bins->boxes[axis][bin].max);
    vec4_transpose3(boxes[0].max - boxes[0].min, boxes[1].max - boxes[1].min, boxes[2].max - boxes[2].min, &x, &y, &z);
    return x * y + y * z + z * x;
}

/* The best plane of each axis, a lane an axis. */
struct candidates {
    vec4 cost;
    vec4 larger; /* the larger side's count */
    vec4 bin; /* 0: none */
};

/* Where nothing lies on one side its area is infinite and its count 0: the cost is NaN and never taken. */
static struct candidates find_candidates(const struct bins *bins, const struct bins_mapping *mapping, uint32_t count)
{
    vec4 right_costs[BINS_MAX], right_counts[BINS_MAX];
    struct vec4_box boxes[3] = {vec4_box_empty(), vec4_box_empty(), vec4_box_empty()};
    vec4_int sum = {0};
    for (uint32_t bin = mapping->bins - 1; bin > 0; bin--) {
        sum += bins->counts[bin];
        right_counts[bin] = __builtin_convertvector(sum, vec4);
        right_costs[bin] = grow_all(boxes, bins, bin) * right_counts[bin];
    }
    struct candidates best = {vec4_all(INFINITY), vec4_all(INFINITY), vec4_all(0)};
    boxes[0] = boxes[1] = boxes[2] = vec4_box_empty();
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

bool bins_choose(const struct bins *bins, const struct bins_mapping *mapping, uint32_t count, struct bins_plane *ret_plane)
{
    struct candidates found = find_candidates(bins, mapping, count);
    int best = 0;
    for (int axis = 1; axis < 3; axis++)
        if (found.cost[axis] < found.cost[best] || (found.cost[axis] == found.cost[best] && found.larger[axis] < found.larger[best]))
            best = axis;
    if (found.bin[best] == 0)
        return false;
    struct vec4_box sides[2] = {vec4_box_empty(), vec4_box_empty()};
    uint32_t bin = 0;
    ret_plane->axis = (unsigned)best;
    ret_plane->bin = (uint32_t)found.bin[best];
    for (; bin < ret_plane->bin; bin++)
        vec4_box_grow(&sides[0], bins->boxes[best][bin].min, bins->boxes[best][bin].max);
    for (; bin < mapping->bins; bin++)
        vec4_box_grow(&sides[1], bins->boxes[best][bin].min, bins->boxes[best][bin].max);
    ret_plane->left_count = bins_left_count(bins, ret_plane);
    ret_plane->left = sides[0];
    ret_plane->right = sides[1];
    return true;
}

uint32_t bins_left_count(const struct bins *bins, const struct bins_plane *plane)
{
    vec4_int sum = {0};
    for (uint32_t bin = 0; bin < plane->bin; bin++)
        sum += bins->counts[bin];
    return (uint32_t)sum[plane->axis];
}

void bins_partition(const struct bins_mapping *mapping, const struct bins_plane *plane, const struct primitive_ref *refs,
                    uint32_t count, struct primitive_ref *left, struct primitive_ref *right, struct vec4_box ret_centroids[2])
{
    const struct bins_mapping local = *mapping;
    vec4 threshold = vec4_all(-INFINITY);
    threshold[plane->axis] = (float)plane->bin;
    struct vec4_box left_box = vec4_box_empty(), right_box = vec4_box_empty();
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]);
        vec4 centroid = box.min + box.max;
        int32_t goes_left = vec4_bits(place(&local, centroid) < threshold) != 0;
        vec4_box_store(goes_left ? left : right, box);
        left += goes_left;
        right += 1 - goes_left;
        /* All bits set make a NaN, which the boxes of the other side do not take. */
        vec4_int to_left = {-goes_left, -goes_left, -goes_left, -goes_left};
        vec4 for_left = vec4_or(centroid, ~to_left), for_right = vec4_or(centroid, to_left);
        vec4_box_grow(&left_box, for_left, for_left);
        vec4_box_grow(&right_box, for_right, for_right);
    }
    ret_centroids[0] = left_box;
    ret_centroids[1] = right_box;
}
