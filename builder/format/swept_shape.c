/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/swept_shape.h"

#include <math.h>

#include "proto/base/round_outward.h"

/* Which part of a linear swept sphere there is. */
enum part { NOTHING, FIRST_SPHERE, SECOND_SPHERE, ANY_PART, CONE };

/* A linear swept sphere with its values for all axes. */
struct shape {
    float ends[2][4]; /* finite */
    double along[3]; /* from the first centre to the second one */
    double squares[3], square; /* of these distances, and of the whole */
    double difference; /* of the radii */
};

static float clamp(float value)
{
    return value > FLT_MAX ? FLT_MAX : value < -FLT_MAX ? -FLT_MAX : value;
}

/*
 * Returns the smallest float that is at least a + b. The sum of two floats can take more bits than a double has, so
 * that what was rounded off decides if the sum is a float.
 */
static float sum_up(float a, float b)
{
    const double sum = (double)a + b, part = sum - a, rest = (a - (sum - part)) + (b - part);
    const float rounded = round_up(sum);
    return clamp(rounded == sum && rest > 0 ? nextafterf(rounded, INFINITY) : rounded);
}

static void add_sphere(const float sphere[4], struct box *box)
{
    for (int axis = 0; axis < 3; axis++) {
        const float low = -sum_up(-sphere[axis], sphere[3]), high = sum_up(sphere[axis], sphere[3]);
        box->min[axis] = low < box->min[axis] ? low : box->min[axis];
        box->max[axis] = high > box->max[axis] ? high : box->max[axis];
    }
}

struct box swept_shape_sphere(const float sphere[4])
{
    const float finite[4] = {clamp(sphere[0]), clamp(sphere[1]), clamp(sphere[2]), clamp(sphere[3])};
    struct box box = box_empty();
    add_sphere(finite, &box);
    return box;
}

static void load(const float first[4], const float second[4], struct shape *ret_shape)
{
    for (int k = 0; k < 4; k++) {
        ret_shape->ends[0][k] = clamp(first[k]);
        ret_shape->ends[1][k] = clamp(second[k]);
    }
    ret_shape->square = 0;
    for (int axis = 0; axis < 3; axis++) {
        ret_shape->along[axis] = (double)ret_shape->ends[1][axis] - ret_shape->ends[0][axis];
        ret_shape->squares[axis] = ret_shape->along[axis] * ret_shape->along[axis];
        ret_shape->square += ret_shape->squares[axis];
    }
    ret_shape->difference = (double)ret_shape->ends[0][3] - ret_shape->ends[1][3];
}

/*
 * With u = 2^-53, the square of the length has a relative error below 6 u, and that of the radii's difference below 4
 * u. No square underflows or overflows. What 2^-40 leaves open can be any part.
 */
static enum part part_of(const struct shape *shape, unsigned caps)
{
    const double square = shape->difference * shape->difference;
    const bool is_first = shape->difference >= 0;
    if (shape->square <= square * (1 - 0x1p-40))
        return !(caps & (is_first ? SWEPT_SHAPE_CAP_FIRST : SWEPT_SHAPE_CAP_SECOND)) ? NOTHING
               : is_first                                                            ? FIRST_SPHERE
                                                                                     : SECOND_SPHERE;
    return shape->square <= square * (1 + 0x1p-40) ? ANY_PART : CONE;
}

/* The tangent cone of a swept sphere, from which the circles of both ends follow; add_end() explains the letters. */
struct cone {
    double s, circle; /* the radius of an end's circle, as a share of the end's own */
    double d[3], across[3]; /* the root of 1 - d[k]^2 */
};

/*
 * Adds what an end reaches along the axes: the reach of its sphere where the extreme point belongs to its cap, and that
 * of its tangent circle otherwise, which bounds the cap and the side.
 *
 * With the unit vector d along the axis and s = (r0 - r1) / length, the circle has the centre p + r s d and the radius
 * r sqrt(1 - s^2), and reaches this times sqrt(1 - d[k]^2) along axis k. The extreme point p[k] + r belongs to the
 * first end's cap if d[k] <= s, and to the second one's if d[k] >= s; -d[k] takes the place of d[k] for p[k] - r. On
 * the circle itself both are the same, so that it does no harm to take the sphere's reach where rounding leaves this
 * open.
 *
 * In u = 2^-53: s and d[k] have relative errors below 6, so that r s d[k] is off by at most 15 r. 1 - s^2 is off by at
 * most 14, which the addition of 2^-48 = 32 u makes up for; the root of 1 - d[k]^2, as a quotient of sums of squares,
 * has a relative error below 7, and the circle's reach with the products one below 12. The last sums add at most |p[k]|
 * + 3 r. Together this is below 32 u (|p[k]| + r).
 */
static void add_end(const struct shape *shape, const struct cone *cone, int end, bool has_cap, struct box *box)
{
    const float *p = shape->ends[end];
    const double s = cone->s, radius = p[3], circle = radius * cone->circle;
    for (int axis = 0; axis < 3; axis++) {
        const double d = cone->d[axis], centre = p[axis] + radius * s * d;
        const double reach = circle * cone->across[axis] + (fabs(p[axis]) + radius) * 0x1p-48;
        const double beyond = end == 0 ? s : -s, up = end == 0 ? d : -d; /* signed so that up <= beyond is the cap */
        const float low = -sum_up(-p[axis], p[3]), high = sum_up(p[axis], p[3]);
        const float circle_low = round_down(centre - reach), circle_high = round_up(centre + reach);
        const float min = (has_cap && -up <= beyond + 0x1p-48) || circle_low < low ? low : circle_low;
        const float max = (has_cap && up <= beyond + 0x1p-48) || circle_high > high ? high : circle_high;
        box->min[axis] = min < box->min[axis] ? min : box->min[axis];
        box->max[axis] = max > box->max[axis] ? max : box->max[axis];
    }
}

static void add_cone(const struct shape *shape, unsigned caps, struct box *box)
{
    const double length = sqrt(shape->square), s = shape->difference / length;
    struct cone cone = {.s = s, .circle = sqrt(fmax(1 - s * s, 0) + 0x1p-48)};
    for (int axis = 0; axis < 3; axis++) {
        const double others = shape->squares[(axis + 1) % 3] + shape->squares[(axis + 2) % 3];
        cone.d[axis] = shape->along[axis] / length;
        cone.across[axis] = sqrt(others / shape->square);
    }
    add_end(shape, &cone, 0, caps & SWEPT_SHAPE_CAP_FIRST, box);
    add_end(shape, &cone, 1, caps & SWEPT_SHAPE_CAP_SECOND, box);
}

struct box swept_shape_box(const float first[4], const float second[4], unsigned caps)
{
    struct shape shape;
    struct box box = box_empty();
    load(first, second, &shape);
    const enum part part = caps == SWEPT_SHAPE_CAPS ? ANY_PART : part_of(&shape, caps);
    if (part == NOTHING)
        box_add_point(&box, shape.ends[shape.difference < 0]);
    if (part == FIRST_SPHERE || part == ANY_PART)
        add_sphere(shape.ends[0], &box);
    if (part == SECOND_SPHERE || part == ANY_PART)
        add_sphere(shape.ends[1], &box);
    if (part == CONE)
        add_cone(&shape, caps, &box);
    return box;
}

bool swept_shape_is_nothing(const float first[4], const float second[4], unsigned caps)
{
    struct shape shape;
    if (first[3] == 0 && second[3] == 0)
        return true;
    load(first, second, &shape);
    return caps != SWEPT_SHAPE_CAPS && part_of(&shape, caps) == NOTHING;
}
