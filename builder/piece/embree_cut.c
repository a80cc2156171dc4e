/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/embree_cut.h"

#include <math.h>

#include "builder/kernel/clip.h"

/* A little more than the least thickness, so that rounding does not make it less. */
static const float thick = 1.125f * EMBREE_THICKNESS;

struct embree_space embree_space_for(const struct box *bounds)
{
    struct embree_space space = {.scale = 1, .unscale = 1};
    double largest = 0;
    for (int axis = 0; axis < 3; axis++) {
        space.centre[axis] = ((double)bounds->min[axis] + bounds->max[axis]) / 2;
        largest = fmax(largest, ((double)bounds->max[axis] - bounds->min[axis]) / 2);
    }
    if (largest > 0) {
        const int exponent = ilogb(largest) + 1;
        space.scale = ldexp(1, -exponent);
        space.unscale = ldexp(1, exponent);
    }
    return space;
}

static float into(const struct embree_space *space, int axis, float value)
{
    return (float)((value - space->centre[axis]) * space->scale);
}

struct box embree_space_box(const struct embree_space *space, const struct box *box)
{
    struct box result;
    for (int axis = 0; axis < 3; axis++) {
        result.min[axis] = into(space, axis, box->min[axis]);
        result.max[axis] = into(space, axis, box->max[axis]);
    }
    return result;
}

void embree_space_thicken(struct box *box)
{
    for (int axis = 0; axis < 3; axis++) {
        const float thickness = box->max[axis] - box->min[axis];
        if (thickness > 0 && thickness < EMBREE_THICKNESS) {
            const float middle = 0.5f * (box->min[axis] + box->max[axis]);
            box->min[axis] = middle - 0.5f * thick;
            box->max[axis] = middle + 0.5f * thick;
        }
    }
}

struct embree_triangle embree_triangle_load(const struct embree_space *space, const struct canonical *canonical,
                                            uint32_t id)
{
    const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
    struct embree_triangle triangle;
    float largest = 1;
    canonical_triangle(geometry, id - geometry->first_primitive, triangle.corners);
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 3; axis++) {
            triangle.corners[k][axis] = into(space, axis, triangle.corners[k][axis]);
            largest = fmaxf(largest, fabsf(triangle.corners[k][axis]));
        }
    /* A corner is rounded by 2^-24 of it, and so is a face of the part, whose magnitude is about 1 at most. */
    triangle.error = largest * 0x1p-22f;
    return triangle;
}

struct box embree_cut_outward(const struct embree_space *space, const struct embree_triangle *triangle,
                              const struct box *part)
{
    struct box result;
    for (int axis = 0; axis < 3; axis++) {
        const double min = ((double)part->min[axis] - triangle->error) * space->unscale + space->centre[axis],
                     max = ((double)part->max[axis] + triangle->error) * space->unscale + space->centre[axis];
        const float low = (float)min, high = (float)max;
        result.min[axis] = low > min ? nextafterf(low, -INFINITY) : low;
        result.max[axis] = high < max ? nextafterf(high, INFINITY) : high;
    }
    return result;
}

enum { IN_NEITHER = 0, IN_LEFT = 1, IN_RIGHT = 2, IN_BOTH = 3 };

/* Says on which sides of a plane a range counts. */
static int sides_of(float low, float high, float position)
{
    const float middle = 0.5f * (low + high), unclear = EMBREE_THICKNESS / 4;
    if (!(low <= high))
        return IN_NEITHER;
    if (high - low < 4 * EMBREE_THICKNESS)
        return middle < position - unclear ? IN_LEFT : middle > position + unclear ? IN_RIGHT : IN_NEITHER;
    return high - position < EMBREE_THICKNESS ? IN_LEFT : position - low < EMBREE_THICKNESS ? IN_RIGHT : IN_BOTH;
}

/*
 * Narrows a half to the part of the triangle in it, except on the axis of the plane, where it ends at the plane. What
 * is left stays as thick as EMBREE_THICKNESS, if the half is.
 */
static void narrow(const struct box *cut, int plane_axis, struct box *half)
{
    for (int axis = 0; axis < 3; axis++) {
        const float low = half->min[axis], high = half->max[axis];
        float min = cut->min[axis], max = cut->max[axis];
        if (axis == plane_axis)
            continue;
        if (max - min < EMBREE_THICKNESS) {
            const float least = low > max - thick ? low : max - thick;
            min = least < min ? least : min;
            const float most = high < min + thick ? high : min + thick;
            max = most > max ? most : max;
        }
        half->min[axis] = min;
        half->max[axis] = max;
    }
}

void embree_cut(const struct embree_triangle *triangle, const struct box *part, unsigned axis, float position,
                struct box *ret_left, struct box *ret_right)
{
    const int sides = sides_of(part->min[axis], part->max[axis], position);
    *ret_left = sides & IN_LEFT ? *part : box_empty();
    *ret_right = sides & IN_RIGHT ? *part : box_empty();
    if (sides != IN_BOTH)
        return;
    vec4 corners[3];
    for (int k = 0; k < 3; k++)
        corners[k] = vec4_load3(triangle->corners[k]);
    const struct clip_triangle loaded = clip_from_corners(corners);
    const struct vec4_box limit = vec4_box_from(part);
    struct vec4_box left, right;
    clip_cut_triangle(&loaded, &limit, axis, position, &left, &right);
    const struct box cuts[2] = {vec4_box_get(left), vec4_box_get(right)};
    ret_left->max[axis] = ret_right->min[axis] = position;
    narrow(&cuts[0], (int)axis, ret_left);
    narrow(&cuts[1], (int)axis, ret_right);
}
