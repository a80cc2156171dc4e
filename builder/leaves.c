/* SPDX-License-Identifier: Apache-2.0 */
#include "leaves.h"

#include <math.h>
#include <string.h>

#include "vec4.h"

/* What a cut costs, in half areas: a little more than a node does, so that two triangles of one box share a leaf. */
static const float cut_cost = 1.05f;

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

/* Fills ret_lengths[i]: how many refs the last leaf has if the row ends with ref i. */
static void choose(const struct primitive_ref *refs, uint32_t count, uint32_t leaf_max, uint8_t *ret_lengths)
{
    const int32_t most = leaf_max < INT8_MAX ? (int32_t)leaf_max : INT8_MAX;
    const vec4_int limits = {INT32_MAX, most, most, most};
    struct vec4_box last = vec4_box_load(&refs[0]), last_two = last;
    vec4_int primitives = {most, most, most, 0}; /* nothing reaches beyond the row's begin */
    /* The least cost of all refs before the last one, before the last two, the last three. */
    float last_area = 0;
    double before = 0, before_two = 0, before_three = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box one = vec4_box_load(&refs[i]), two = one, three = one;
        vec4_box_grow(&two, last.min, last.max);
        vec4_box_grow(&three, last_two.min, last_two.max);
        int32_t own = 1 + (int32_t)refs[i].geometry;
        primitives = (vec4_int){own, own + primitives[0], own + primitives[1], 0};
        vec4 areas = half_areas(one, two, three);
        vec4 costs = vec4_select(primitives > limits, vec4_all(INFINITY), areas * __builtin_convertvector(primitives, vec4));
        float near = 2 * least_float(areas[0], last_area);
        last_area = areas[0];
        before += (double)(cut_cost * least_float(areas[1], near));
        double first = before + (double)costs[0], second = before_two + (double)costs[1], third = before_three + (double)costs[2];
        double others = least(third, second);
        unsigned is_third = third < second, is_longer = others < first;
        ret_lengths[i] = (uint8_t)(1 + is_longer + (is_longer & is_third));
        before_three = before_two;
        before_two = before;
        before = least(others, first);
        last = one;
        last_two = two;
    }
}

uint32_t leaves_cut(const struct primitive_ref *refs, uint32_t count, uint32_t leaf_max, uint8_t *ret_lengths)
{
    uint32_t leaves = 0;
    choose(refs, count, leaf_max, ret_lengths);
    /* From the end to the begin, into the end of the array, of which the choices are behind us. */
    for (uint32_t at = count; at > 0; leaves++) {
        uint8_t length = ret_lengths[at - 1];
        ret_lengths[count - leaves - 1] = length;
        at -= length;
    }
    memmove(ret_lengths, ret_lengths + count - leaves, leaves);
    return leaves;
}
