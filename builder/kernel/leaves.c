/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/kernel/leaves.h"

#include <math.h>
#include <string.h>

/*
 * One ref of each range, by lanes. Each step of the dynamic programming waits for the one before it; four ranges take
 * their steps together.
 */
struct ref_lanes {
    vec4 min[3], max[3];
    vec4_int primitives;
};

static inline void transpose(vec4 a, vec4 b, vec4 c, vec4 d, vec4 ret_columns[4])
{
    vec4 xy = __builtin_shufflevector(a, b, 0, 4, 1, 5), xy2 = __builtin_shufflevector(c, d, 0, 4, 1, 5);
    vec4 zw = __builtin_shufflevector(a, b, 2, 6, 3, 7), zw2 = __builtin_shufflevector(c, d, 2, 6, 3, 7);
    ret_columns[0] = __builtin_shufflevector(xy, xy2, 0, 1, 4, 5);
    ret_columns[1] = __builtin_shufflevector(xy, xy2, 2, 3, 6, 7);
    ret_columns[2] = __builtin_shufflevector(zw, zw2, 0, 1, 4, 5);
    ret_columns[3] = __builtin_shufflevector(zw, zw2, 2, 3, 6, 7);
}

static inline struct ref_lanes load_lanes(const struct primitive_ref *const refs[LEAVES_RANGES])
{
    struct ref_lanes lanes;
    struct vec4_box a = vec4_box_load(refs[0]), b = vec4_box_load(refs[1]), c = vec4_box_load(refs[2]),
                    d = vec4_box_load(refs[3]);
    vec4 min[4], max[4];
    transpose(a.min, b.min, c.min, d.min, min);
    transpose(a.max, b.max, c.max, d.max, max);
    memcpy(lanes.min, min, sizeof lanes.min);
    memcpy(lanes.max, max, sizeof lanes.max);
    /* The lane after a ref's minimum holds how many primitives follow its first one. */
    lanes.primitives = (vec4_int)min[3] + 1;
    return lanes;
}

static inline void grow(struct ref_lanes *lanes, const struct ref_lanes *other)
{
    for (int axis = 0; axis < 3; axis++) {
        lanes->min[axis] = vec4_min(lanes->min[axis], other->min[axis]);
        lanes->max[axis] = vec4_max(lanes->max[axis], other->max[axis]);
    }
    lanes->primitives += other->primitives;
}

static inline vec4 half_areas(const struct ref_lanes *lanes)
{
    vec4 x = lanes->max[0] - lanes->min[0], y = lanes->max[1] - lanes->min[1], z = lanes->max[2] - lanes->min[2];
    return x * y + y * z + z * x;
}

/*
 * The state of the dynamic programming after some refs: the last ref and the box of the last two. before_two and
 * before_three: the least cost of everything before a leaf that holds the next ref and the last one, or the last two,
 * with the cut before that leaf, minus the least cost of all refs so far.
 */
struct rows {
    struct ref_lanes last, last_two;
    vec4 last_area, before_two, before_three;
};

static inline vec4 leaf_cost(vec4 area, vec4_int primitives, vec4_int most)
{
    return vec4_select(primitives > most, vec4_all(INFINITY), area * __builtin_convertvector(primitives, vec4));
}

/*
 * Advances by one ref in each range, and returns the length of the last leaf of the cheapest cut. A cost that is NaN
 * never compares less, so it is not chosen.
 */
static inline vec4_int go_on(struct rows *rows, const struct ref_lanes *one, vec4_int most, float cut_cost)
{
    struct ref_lanes two = *one, three = *one;
    grow(&two, &rows->last);
    grow(&three, &rows->last_two);
    vec4 area = half_areas(one), area_two = half_areas(&two);
    vec4 cut = cut_cost * vec4_min(area_two, 2 * vec4_min(area, rows->last_area));
    vec4 first = cut + area * __builtin_convertvector(one->primitives, vec4);
    vec4 second = rows->before_two + leaf_cost(area_two, two.primitives, most);
    vec4 third = rows->before_three + leaf_cost(half_areas(&three), three.primitives, most);
    vec4 longer = vec4_min(third, second), least = vec4_min(longer, first);
    vec4_int is_third = third < second, is_longer = longer < first;
    *rows = (struct rows){*one, two, area, cut - least, rows->before_two - least};
    return 1 - is_longer - (is_longer & is_third);
}

static uint32_t range_length(uint32_t count)
{
    return count / LEAVES_RANGES + (count % LEAVES_RANGES != 0);
}

/*
 * Fills ret_lengths[i] with the number of refs that the last leaf has when the range ends with ref i. Ranges that are
 * shorter than the first repeat the last ref, without effect.
 */
static void choose(const struct primitive_ref *refs, uint32_t count, const struct leaves_options *options,
                   uint8_t *ret_lengths)
{
    const uint32_t length = range_length(count);
    const int32_t limit = options->leaf_max < INT8_MAX ? (int32_t)options->leaf_max : INT8_MAX;
    const vec4_int most = {limit, limit, limit, limit};
    struct rows rows = {.before_two = vec4_all(INFINITY), .before_three = vec4_all(INFINITY)};
    for (uint32_t i = 0; i < length; i++) {
        const struct primitive_ref *own[LEAVES_RANGES];
        uint8_t *to[LEAVES_RANGES], nobody;
        for (uint32_t range = 0; range < LEAVES_RANGES; range++) {
            uint64_t at = (uint64_t)range * length + i;
            own[range] = &refs[at < count ? at : count - 1];
            to[range] = at < count ? &ret_lengths[at] : &nobody;
        }
        struct ref_lanes one = load_lanes(own);
        if (i == 0)
            rows.last = rows.last_two = one;
        vec4_int lengths = go_on(&rows, &one, most, options->cut_cost);
        for (uint32_t range = 0; range < LEAVES_RANGES; range++)
            *to[range] = (uint8_t)lengths[range];
    }
}

/*
 * A walk through one range from its end to its start, which collects the chosen lengths; no leaf lies in two ranges.
 * The lengths are stored at the end of the range, over choices that the walk has passed.
 */
struct length_walk {
    const uint8_t *begin, *at;
    uint8_t *to;
};

static inline void walk_on(struct length_walk *walk)
{
    const uint8_t length = walk->at[-1];
    *--walk->to = length;
    walk->at -= length;
}

/* Takes `steps` steps in all ranges alternately, because each step waits for the one before it in the same range. */
static void walk_together(struct length_walk walks[LEAVES_RANGES], size_t steps)
{
    struct length_walk own[LEAVES_RANGES];
    memcpy(own, walks, sizeof own);
    for (; steps > 0; steps--)
        for (int range = 0; range < LEAVES_RANGES; range++)
            walk_on(&own[range]);
    memcpy(walks, own, sizeof own);
}

/* Returns how many steps every range can take without reaching its start. */
static size_t steps_for_all(const struct length_walk walks[LEAVES_RANGES])
{
    size_t least = SIZE_MAX;
    for (int range = 0; range < LEAVES_RANGES; range++) {
        size_t left = (size_t)(walks[range].at - walks[range].begin);
        least = left < least ? left : least;
    }
    return least / LEAVES_REFS_MAX;
}

uint32_t leaves_cut(const struct primitive_ref *refs, uint32_t count, const struct leaves_options *options,
                    uint8_t *ret_lengths)
{
    uint8_t *bounds[LEAVES_RANGES + 1], *next = ret_lengths;
    struct length_walk walks[LEAVES_RANGES];
    size_t steps;
    choose(refs, count, options, ret_lengths);
    for (uint64_t range = 0; range <= LEAVES_RANGES; range++)
        bounds[range] = ret_lengths + (range * range_length(count) < count ? range * range_length(count) : count);
    for (int range = 0; range < LEAVES_RANGES; range++)
        walks[range] = (struct length_walk){bounds[range], bounds[range + 1], bounds[range + 1]};
    while ((steps = steps_for_all(walks)) > 0)
        walk_together(walks, steps);
    for (int range = 0; range < LEAVES_RANGES; range++) {
        struct length_walk *walk = &walks[range];
        while (walk->at > walk->begin)
            walk_on(walk);
        size_t leaves = (size_t)(bounds[range + 1] - walk->to);
        memmove(next, walk->to, leaves);
        next += leaves;
    }
    return (uint32_t)(next - ret_lengths);
}
