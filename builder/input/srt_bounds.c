/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/srt_bounds.h"

#include <math.h>

#include "builder/input/classification.h"
#include "builder/input/transform.h"
#include "proto/base/round_outward.h"

/*
 * The most parts of a turn, which is one of less than 360 degrees, and the scalar product of quaternions between which
 * there are 7.5 degrees, and so 15 degrees between the rotations.
 */
enum { PARTS = 32 };
static const double part_product = 0.99144486137381038;

struct quaternion {
    double q[4];
};

static double product(const struct quaternion *a, const struct quaternion *b)
{
    return a->q[0] * b->q[0] + a->q[1] * b->q[1] + a->q[2] * b->q[2] + a->q[3] * b->q[3];
}

static struct quaternion load(const float srt[SRT_NUMBERS])
{
    return (struct quaternion){{srt[SRT_QX], srt[SRT_QY], srt[SRT_QZ], srt[SRT_QW]}};
}

/* Returns the sum, brought to length 1: of two of length 1, the rotation in the middle between them. */
static struct quaternion middle(const struct quaternion *a, const struct quaternion *b)
{
    struct quaternion sum;
    for (int i = 0; i < 4; i++)
        sum.q[i] = a->q[i] + b->q[i];
    const double length = sqrt(product(&sum, &sum));
    for (int i = 0; i < 4; i++)
        sum.q[i] /= length;
    return sum;
}

/* Returns the square of the least length of a quaternion between both. */
static double least_square(const struct quaternion *a, const struct quaternion *b)
{
    struct quaternion way, least;
    for (int i = 0; i < 4; i++)
        way.q[i] = b->q[i] - a->q[i];
    const double all = product(&way, &way), at = all > 0 ? fmin(fmax(-product(a, &way) / all, 0), 1) : 0;
    for (int i = 0; i < 4; i++)
        least.q[i] = a->q[i] + at * way.q[i];
    return product(&least, &least);
}

/* A turn in parts: the rotations at their ends. */
struct turn {
    struct quaternion ends[PARTS + 1];
    int parts;
    double rounding; /* how far, as an angle, the rounding of interpolated quaternions moves the rotation at the most */
};

/*
 * Divides the turn. Returns false where rounding may turn the quaternion anywhere. With u = 2^-24, interpolation moves
 * each of its numbers by less than 4 u of the greater magnitude of both ends.
 */
static bool divide(const struct quaternion *start, const struct quaternion *end, struct turn *turn)
{
    const double squares[2] = {product(start, start), product(end, end)}, least = least_square(start, end);
    const double greatest = fmax(squares[0], squares[1]);
    if (!(greatest > 0x1p-200 && least > greatest * 0x1p-20))
        return false;
    turn->rounding = 2.1 * 0x1p-22 * sqrt((squares[0] + squares[1]) / least);
    turn->ends[0] = middle(start, start);
    turn->ends[1] = middle(end, end);
    turn->parts = 1;
    while (turn->parts < PARTS && product(&turn->ends[0], &turn->ends[1]) < part_product) {
        turn->parts *= 2;
        for (int i = turn->parts; i > 0; i -= 2) {
            turn->ends[i] = turn->ends[i / 2];
            turn->ends[i - 1] = middle(&turn->ends[i / 2 - 1], &turn->ends[i / 2]);
        }
    }
    return true;
}

/* How far what the scales of an SRT make of a box reaches from the pivot. */
static double radius_of(const float srt[SRT_NUMBERS], const struct box *box)
{
    double greatest = 0;
    for (int corner = 0; corner < 8; corner++) {
        const double x = corner & 1 ? box->max[0] : box->min[0], y = corner & 2 ? box->max[1] : box->min[1],
                     z = corner & 4 ? box->max[2] : box->min[2];
        const double a = srt[SRT_SX] * x + srt[SRT_A] * y + srt[SRT_B] * z + srt[SRT_PVX],
                     b = srt[SRT_SY] * y + srt[SRT_C] * z + srt[SRT_PVY], c = srt[SRT_SZ] * z + srt[SRT_PVZ];
        greatest = fmax(greatest, a * a + b * b + c * c);
    }
    return sqrt(greatest);
}

static double greater(const float *start, const float *end, int number)
{
    return fmax(fabs((double)start[number]), fabs((double)end[number]));
}

/* Returns the sum of the magnitudes of all products in the scales of any time, of which rounding takes a part. */
static double magnitude_of(const float *start, const float *end, const struct box *box)
{
    double p[3];
    for (int axis = 0; axis < 3; axis++)
        p[axis] = fmax(fabs((double)box->min[axis]), fabs((double)box->max[axis]));
    return greater(start, end, SRT_SX) * p[0] + (greater(start, end, SRT_A) + greater(start, end, SRT_SY)) * p[1] +
           (greater(start, end, SRT_B) + greater(start, end, SRT_C) + greater(start, end, SRT_SZ)) * p[2] +
           greater(start, end, SRT_PVX) + greater(start, end, SRT_PVY) + greater(start, end, SRT_PVZ);
}

static void grow(const struct quaternion *rotation, const float srt[SRT_NUMBERS], const struct box *box, double min[3],
                 double max[3])
{
    double matrix[12], low[3], high[3];
    srt_turn(rotation->q, srt, matrix);
    transform_bounds(matrix, box, low, high);
    for (int axis = 0; axis < 3; axis++) {
        min[axis] = fmin(min[axis], low[axis]);
        max[axis] = fmax(max[axis], high[axis]);
    }
}

/*
 * Bounds what all rotations make of the box with the scales of one end, without translation. `turn` is NULL if they may
 * be any. The cosine of half a part's angle is the product of the quaternions at its ends. The box of another time is
 * interpolated between those of both ends, as its scales are.
 */
static void bound_turn(const struct turn *turn, const float srt[SRT_NUMBERS], const struct box *box, double min[3],
                       double max[3])
{
    const double radius = radius_of(srt, box);
    double least = turn ? 1 : 0;
    for (int axis = 0; axis < 3; axis++) {
        min[axis] = turn ? INFINITY : 0;
        max[axis] = turn ? -INFINITY : 0;
    }
    for (int i = 0; turn && i <= turn->parts; i++) {
        grow(&turn->ends[i], srt, box, min, max);
        least = i > 0 ? fmin(least, product(&turn->ends[i - 1], &turn->ends[i])) : least;
    }
    const double growth = radius * (1 - least + 0x1p-40 + (turn ? turn->rounding : 0));
    for (int axis = 0; axis < 3; axis++) {
        min[axis] -= growth;
        max[axis] += growth;
    }
}

void srt_bounds(const float start[SRT_NUMBERS], const float end[SRT_NUMBERS], const struct box *box,
                struct box ret_boxes[2])
{
    const struct quaternion first = load(start), last = load(end);
    const float *const keys[2] = {start, end};
    const double rounding = magnitude_of(start, end, box) * 0x1p-21 + 0x1p-140;
    struct turn turn;
    const bool is_divided = divide(&first, &last, &turn);
    for (int key = 0; key < 2; key++) {
        double min[3], max[3];
        bound_turn(is_divided ? &turn : NULL, keys[key], box, min, max);
        for (int axis = 0; axis < 3; axis++) {
            const double slack = rounding + greater(start, end, SRT_TX + axis) * 0x1p-21,
                         place = keys[key][SRT_TX + axis];
            ret_boxes[key].min[axis] = classification_clamp(round_down(place + min[axis] - slack));
            ret_boxes[key].max[axis] = classification_clamp(round_up(place + max[axis] + slack));
        }
    }
}
