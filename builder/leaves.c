/* SPDX-License-Identifier: Apache-2.0 */
#include "leaves.h"

#include <math.h>
#include <string.h>

#include "vec4.h"

/* What a cut costs, in half areas: more than a node does, since larger leaves save time and cost rays little. */
static const float cut_cost = 1.7f;

/* a < b ? a : b, without a branch: nobody can foresee which. */
static inline double least(double a, double b)
{
#if defined(__SSE2__)
    return _mm_cvtsd_f64(_mm_min_sd(_mm_set_sd(a), _mm_set_sd(b)));
#else
    return a < b ? a : b;
#endif
}

static inline float least_float(float a, float b)
{
    return vec4_min(vec4_all(a), vec4_all(b))[0];
}

/* The half areas of three boxes. */
static inline vec4 half_areas(struct vec4_box a, struct vec4_box b, struct vec4_box c)
{
    vec4 x, y, z;
    vec4_transpose3(a.max - a.min, b.max - b.min, c.max - c.min, &x, &y, &z);
    return x * y + y * z + z * x;
}

/* The least costs of the refs before the last one of the row so far, before the last two and the last three; beyond its begin there are none. */
struct cuts {
    double one, two, three;
};

/* Goes on by a ref: the costs of leaves of the last one, two and three, and what a cut before this one costs. Returns the last leaf's length. */
static inline uint8_t go_on(struct cuts *cuts, vec4 costs, float cut)
{
    double first = cuts->one + (double)(cut + costs[0]), second = cuts->two + (double)costs[1], third = cuts->three + (double)costs[2];
    double longer = least(third, second);
    unsigned is_third = third < second, is_longer = longer < first;
    *cuts = (struct cuts){least(longer, first), cuts->one + (double)cut, cuts->two};
    return (uint8_t)(1 + is_longer + (is_longer & is_third));
}

/* Fills ret_lengths[i]: how many refs the last leaf has if the row ends with ref i. Sums that are no numbers are less than nothing. */
static inline __attribute__((always_inline)) void choose(const struct primitive_ref *refs, uint32_t count, int32_t most, bool single,
                                                         uint8_t *ret_lengths)
{
    const vec4_int limits = {INT32_MAX, most, most, most};
    struct vec4_box last = vec4_box_load(&refs[0]), last_two = last;
    vec4_int primitives = {1, 2, 3, 0}; /* of the last one, two, three */
    struct cuts cuts = {0, INFINITY, INFINITY};
    float last_area = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box one = vec4_box_load(&refs[i]), two = one, three = one;
        vec4_box_grow(&two, last.min, last.max);
        vec4_box_grow(&three, last_two.min, last_two.max);
        if (!single) {
            int32_t own = 1 + (int32_t)refs[i].geometry;
            primitives = (vec4_int){own, own + primitives[0], own + primitives[1], 0};
        }
        vec4 areas = half_areas(one, two, three);
        vec4 costs = vec4_select(primitives > limits, vec4_all(INFINITY), areas * __builtin_convertvector(primitives, vec4));
        float near = 2 * least_float(areas[0], last_area);
        ret_lengths[i] = go_on(&cuts, costs, cut_cost * least_float(areas[1], near));
        last_area = areas[0];
        last = one;
        last_two = two;
    }
}

uint32_t leaves_cut(const struct primitive_ref *refs, uint32_t count, uint32_t leaf_max, bool single, uint8_t *ret_lengths)
{
    const int32_t most = leaf_max < INT8_MAX ? (int32_t)leaf_max : INT8_MAX;
    uint32_t leaves = 0;
    if (single)
        choose(refs, count, most, true, ret_lengths);
    else
        choose(refs, count, most, false, ret_lengths);
    /* From the end to the begin, into the end of the array, of which the choices are behind us. */
    for (uint32_t at = count; at > 0; leaves++) {
        uint8_t length = ret_lengths[at - 1];
        ret_lengths[count - leaves - 1] = length;
        at -= length;
    }
    memmove(ret_lengths, ret_lengths + count - leaves, leaves);
    return leaves;
}
