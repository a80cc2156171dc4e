/* SPDX-License-Identifier: Apache-2.0 */
#include "bins.h"

#include <math.h>

void bins_map(const struct box *centroids, uint32_t count, struct bins_mapping *ret_mapping)
{
    struct bins_mapping mapping = {.bins = count >= 1024 ? BINS_MAX : count >= 64 ? 16 : 8};
    for (int axis = 0; axis < 3; axis++) {
        /* A little less than the number of bins, so that the largest centroid falls into the last one. */
        float scale = ((float)mapping.bins - 0.01f) / (centroids->max[axis] - centroids->min[axis]);
        bool usable = scale > 0 && scale <= FLT_MAX;
        mapping.base[axis] = centroids->min[axis];
        mapping.scale[axis] = usable ? scale : 0;
        mapping.axes |= (unsigned)usable << axis;
    }
    *ret_mapping = mapping;
}

void bins_clear(struct bins *bins, const struct bins_mapping *mapping)
{
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t bin = 0; bin < mapping->bins; bin++) {
            bins->boxes[axis][bin] = vec4_box_empty();
            bins->counts[axis][bin] = 0;
        }
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
            bins->counts[axis][bin[axis]]++;
        }
    }
}

void bins_merge(struct bins *bins, const struct bins_mapping *mapping, const struct bins *other)
{
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t bin = 0; bin < mapping->bins; bin++) {
            vec4_box_grow(&bins->boxes[axis][bin], other->boxes[axis][bin].min, other->boxes[axis][bin].max);
            bins->counts[axis][bin] += other->counts[axis][bin];
        }
}

/* Half area, of a box whose sides are at most about 1 after `scale`: neither overflow nor, where it matters, underflow. */
static inline float area(struct vec4_box box, vec4 scale)
{
    vec4 sides = vec4_xyz(box.max - box.min) * scale;
    vec4 products = sides * vec4_rotate(sides);
    return products[0] + products[1] + products[2];
}

struct candidate {
    float cost;
    uint32_t larger; /* the larger side's count */
};

static bool better(struct candidate a, struct candidate b)
{
    return a.cost < b.cost || (a.cost == b.cost && a.larger < b.larger);
}

/* Of one axis. Bins 0 and the last are never empty, so that areas are of boxes. */
static struct candidate choose_on_axis(const struct bins *bins, const struct bins_mapping *mapping, uint32_t count, vec4 scale,
                                       unsigned axis, uint32_t *ret_bin)
{
    float right_areas[BINS_MAX];
    struct vec4_box box = vec4_box_empty();
    for (uint32_t bin = mapping->bins - 1; bin > 0; bin--) {
        vec4_box_grow(&box, bins->boxes[axis][bin].min, bins->boxes[axis][bin].max);
        right_areas[bin] = area(box, scale);
    }
    struct candidate best = {INFINITY, UINT32_MAX};
    box = vec4_box_empty();
    for (uint32_t bin = 1, left = 0; bin < mapping->bins; bin++) {
        vec4_box_grow(&box, bins->boxes[axis][bin - 1].min, bins->boxes[axis][bin - 1].max);
        left += bins->counts[axis][bin - 1];
        uint32_t right = count - left;
        struct candidate candidate = {area(box, scale) * (float)left + right_areas[bin] * (float)right, left > right ? left : right};
        if (better(candidate, best)) {
            best = candidate;
            *ret_bin = bin;
        }
    }
    return best;
}

static void describe_sides(const struct bins *bins, const struct bins_mapping *mapping, struct bins_plane *plane)
{
    struct vec4_box sides[2] = {vec4_box_empty(), vec4_box_empty()};
    for (uint32_t bin = 0; bin < mapping->bins; bin++)
        vec4_box_grow(&sides[bin >= plane->bin], bins->boxes[plane->axis][bin].min, bins->boxes[plane->axis][bin].max);
    plane->left_count = bins_left_count(bins, plane);
    plane->left = vec4_box_get(sides[0]);
    plane->right = vec4_box_get(sides[1]);
}

bool bins_choose(const struct bins *bins, const struct bins_mapping *mapping, uint32_t count, const struct box *bounds,
                 struct bins_plane *ret_plane)
{
    float side = 0;
    for (int axis = 0; axis < 3; axis++) {
        float own = bounds->max[axis] - bounds->min[axis];
        side = own > side ? own : side;
    }
    vec4 scale = vec4_xyz(vec4_all(1 / side <= FLT_MAX ? 1 / side : 1));
    struct candidate best = {INFINITY, UINT32_MAX};
    struct bins_plane plane = {0};
    for (unsigned axis = 0; axis < 3; axis++) {
        uint32_t bin = 0;
        if (!(mapping->axes >> axis & 1))
            continue;
        struct candidate candidate = choose_on_axis(bins, mapping, count, scale, axis, &bin);
        if (better(candidate, best)) {
            best = candidate;
            plane = (struct bins_plane){.axis = axis, .bin = bin};
        }
    }
    if (plane.bin == 0)
        return false;
    describe_sides(bins, mapping, &plane);
    if (plane.left_count == 0 || plane.left_count == count)
        return false;
    *ret_plane = plane;
    return true;
}

uint32_t bins_left_count(const struct bins *bins, const struct bins_plane *plane)
{
    uint32_t count = 0;
    for (uint32_t bin = 0; bin < plane->bin; bin++)
        count += bins->counts[plane->axis][bin];
    return count;
}

void bins_partition(const struct bins_mapping *mapping, const struct bins_plane *plane, const struct primitive_ref *refs,
                    uint32_t count, struct primitive_ref *left, struct primitive_ref *right, struct box ret_centroids[2])
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
    ret_centroids[0] = vec4_box_get(left_box);
    ret_centroids[1] = vec4_box_get(right_box);
}
