/* SPDX-License-Identifier: Apache-2.0 */
/*
 * box.h - axis-aligned boxes in float, which all folders use.
 *
 * A box is empty if min > max on any axis; box_empty() is the neutral element of box_grow. Areas are half areas (dx*dy
 * + dy*dz + dz*dx), because the surface area heuristic needs only ratios.
 */
#ifndef BVHD_BOX_H
#define BVHD_BOX_H

#include <float.h>
#include <stdbool.h>

struct box {
    float min[3], max[3];
};

static inline struct box box_empty(void)
{
    return (struct box){{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}};
}

static inline bool box_is_empty(const struct box *box)
{
    return !(box->min[0] <= box->max[0] && box->min[1] <= box->max[1] && box->min[2] <= box->max[2]);
}

static inline void box_add_point(struct box *box, const float point[3])
{
    for (int axis = 0; axis < 3; axis++) {
        box->min[axis] = point[axis] < box->min[axis] ? point[axis] : box->min[axis];
        box->max[axis] = point[axis] > box->max[axis] ? point[axis] : box->max[axis];
    }
}

static inline void box_grow(struct box *box, const struct box *other)
{
    for (int axis = 0; axis < 3; axis++) {
        box->min[axis] = other->min[axis] < box->min[axis] ? other->min[axis] : box->min[axis];
        box->max[axis] = other->max[axis] > box->max[axis] ? other->max[axis] : box->max[axis];
    }
}

static inline bool box_contains(const struct box *outer, const struct box *inner)
{
    for (int axis = 0; axis < 3; axis++)
        if (inner->min[axis] < outer->min[axis] || inner->max[axis] > outer->max[axis])
            return false;
    return true;
}

/* The result is a double, because a float overflows for sides of 1.8e19 and more. It is 0 for an empty box. */
static inline double box_half_area(const struct box *box)
{
    double x = (double)box->max[0] - box->min[0], y = (double)box->max[1] - box->min[1],
           z = (double)box->max[2] - box->min[2];
    return x < 0 || y < 0 || z < 0 ? 0 : x * y + y * z + z * x;
}

#endif
