/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/moving_bins.h"

#include <math.h>

enum { BINS = 16, AXES = 6 };

struct moving_ref moving_ref_of(const struct box keys[2], uint32_t place)
{
    struct moving_ref ref = {.place = place};
    for (int key = 0; key < 2; key++)
        for (int axis = 0; axis < 3; axis++) {
            ref.keys[key].min[axis] = keys[key].min[axis];
            ref.keys[key].negated_max[axis] = -keys[key].max[axis];
        }
    return ref;
}

void moving_ref_read(struct primitive_finder *finder, uint32_t id, uint32_t place, struct moving_ref *ret_ref)
{
    struct vec4_box boxes[2] = {vec4_box_empty(), vec4_box_empty()};
    primitive_grow_keys(finder, &id, 1, boxes);
    const struct box keys[2] = {vec4_box_get(boxes[0]), vec4_box_get(boxes[1])};
    *ret_ref = moving_ref_of(keys, place);
}

static float lesser(float a, float b)
{
    return a < b ? a : b;
}

void moving_ref_grow(struct moving_ref *ref, const struct moving_ref *other)
{
    for (int key = 0; key < 2; key++)
        for (int axis = 0; axis < 3; axis++) {
            ref->keys[key].min[axis] = lesser(other->keys[key].min[axis], ref->keys[key].min[axis]);
            ref->keys[key].negated_max[axis] =
                lesser(other->keys[key].negated_max[axis], ref->keys[key].negated_max[axis]);
        }
}

void moving_ref_unite(struct moving_ref *ref)
{
    struct moving_ref other = *ref;
    other.keys[0] = ref->keys[1];
    other.keys[1] = ref->keys[0];
    moving_ref_grow(ref, &other);
}

double moving_ref_area(const struct moving_ref *ref)
{
    double sum = 0;
    for (int key = 0; key < 2; key++) {
        double sides[3];
        for (int axis = 0; axis < 3; axis++)
            sides[axis] = -(double)ref->keys[key].negated_max[axis] - ref->keys[key].min[axis];
        sum += sides[0] * sides[1] + sides[1] * sides[2] + sides[2] * sides[0];
    }
    return sum;
}

/* The boxes of a ref or of a bin at one end, in registers. The fourth lanes have no meaning. */
struct ends {
    struct vec4_box keys[2]; /* the maximum is negated */
};

static inline struct ends ends_of(const struct moving_ref *ref)
{
    return (struct ends){{{vec4_load3(ref->keys[0].min), vec4_load3(ref->keys[0].negated_max)},
                          {vec4_load3(ref->keys[1].min), vec4_load3(ref->keys[1].negated_max)}}};
}

static inline struct ends ends_empty(void)
{
    const struct vec4_box box = {vec4_all(FLT_MAX), vec4_all(FLT_MAX)};
    return (struct ends){{box, box}};
}

static inline void ends_grow(struct ends *ends, const struct ends *other)
{
    for (int key = 0; key < 2; key++) {
        ends->keys[key].min = vec4_min(other->keys[key].min, ends->keys[key].min);
        ends->keys[key].max = vec4_min(other->keys[key].max, ends->keys[key].max);
    }
}

/* Sides come out negated, which does not change the products. */
static inline float area_of(const struct ends *ends)
{
    vec4 sum = vec4_all(0);
    for (int key = 0; key < 2; key++) {
        const vec4 sides = ends->keys[key].min + ends->keys[key].max;
        sum += sides * vec4_rotate(sides);
    }
    return sum[0] + sum[1] + sum[2];
}

/* The places of refs: bin = (place - base) * scale; scale is 0 on an axis along which nothing can be separated. */
struct mapping {
    vec4 base[2], scale[2];
};

struct bins {
    struct ends ends[AXES][BINS];
    uint32_t counts[AXES][BINS];
};

/* A plane: refs whose bin on `axis` is below `bin` go left. */
struct plane {
    uint32_t axis, bin, left;
};

static inline vec4 place_of(const struct ends *ends, int key)
{
    return ends->keys[key].min - ends->keys[key].max;
}

static struct mapping map(const struct moving_ref *refs, uint32_t count)
{
    struct vec4_box places[2] = {vec4_box_empty(), vec4_box_empty()};
    struct mapping mapping;
    for (uint32_t i = 0; i < count; i++) {
        const struct ends ends = ends_of(&refs[i]);
        for (int key = 0; key < 2; key++)
            vec4_box_grow(&places[key], place_of(&ends, key), place_of(&ends, key));
    }
    for (int key = 0; key < 2; key++) {
        mapping.base[key] = places[key].min;
        for (int axis = 0; axis < 4; axis++) {
            const float extent = places[key].max[axis] - places[key].min[axis], scale = BINS / extent;
            mapping.scale[key][axis] = axis < 3 && extent > 0 && scale <= FLT_MAX ? scale : 0;
        }
    }
    return mapping;
}

static inline vec4_int bins_of(const struct mapping *mapping, const struct ends *ends, int key)
{
    const vec4 bin = (place_of(ends, key) - mapping->base[key]) * mapping->scale[key];
    return __builtin_convertvector(vec4_min(bin, vec4_all(BINS - 1)), vec4_int);
}

static void add_all(const struct mapping *mapping, const struct moving_ref *refs, uint32_t count, struct bins *bins)
{
    for (int axis = 0; axis < AXES; axis++)
        for (int bin = 0; bin < BINS; bin++) {
            bins->ends[axis][bin] = ends_empty();
            bins->counts[axis][bin] = 0;
        }
    for (uint32_t i = 0; i < count; i++) {
        const struct ends ends = ends_of(&refs[i]);
        const vec4_int start = bins_of(mapping, &ends, 0), end = bins_of(mapping, &ends, 1);
        for (int axis = 0; axis < AXES; axis++) {
            const int32_t bin = axis < 3 ? start[axis] : end[axis - 3];
            ends_grow(&bins->ends[axis][bin], &ends);
            bins->counts[axis][bin]++;
        }
    }
}

/* Finds the plane of least cost, the first one among equals. Returns false if there is none. */
static bool choose(const struct bins *bins, uint32_t count, struct plane *ret_plane)
{
    float least = INFINITY;
    for (uint32_t axis = 0; axis < AXES; axis++) {
        float right_costs[BINS];
        struct ends sum = ends_empty();
        uint32_t refs = 0;
        for (uint32_t bin = BINS; bin-- > 1;) {
            ends_grow(&sum, &bins->ends[axis][bin]);
            refs += bins->counts[axis][bin];
            right_costs[bin] = refs ? area_of(&sum) * (float)refs : 0;
        }
        sum = ends_empty();
        refs = 0;
        for (uint32_t bin = 1; bin < BINS; bin++) {
            ends_grow(&sum, &bins->ends[axis][bin - 1]);
            refs += bins->counts[axis][bin - 1];
            if (refs == 0 || refs == count)
                continue;
            const float cost = area_of(&sum) * (float)refs + right_costs[bin];
            if (cost < least) {
                least = cost;
                *ret_plane = (struct plane){axis, bin, refs};
            }
        }
    }
    return least < INFINITY;
}

static inline bool goes_left(const struct mapping *mapping, const struct moving_ref *ref, const struct plane *plane)
{
    const struct ends ends = ends_of(ref);
    const int key = plane->axis < 3 ? 0 : 1;
    return bins_of(mapping, &ends, key)[plane->axis - (key ? 3 : 0)] < (int32_t)plane->bin;
}

uint32_t moving_bins_divide(struct moving_ref *refs, uint32_t count)
{
    const struct mapping mapping = map(refs, count);
    struct bins bins;
    struct plane plane = {0, 0, 0};
    add_all(&mapping, refs, count, &bins);
    if (!choose(&bins, count, &plane))
        return count / 2;
    uint32_t left = 0, right = count;
    while (left < right) {
        if (goes_left(&mapping, &refs[left], &plane)) {
            left++;
            continue;
        }
        right--;
        const struct moving_ref swap = refs[left];
        refs[left] = refs[right];
        refs[right] = swap;
    }
    return left;
}
