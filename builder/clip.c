/* SPDX-License-Identifier: Apache-2.0 */
#include "clip.h"

#include <math.h>

bool clip_allowed(const struct canonical *canonical)
{
    for (uint32_t i = 0; i < canonical->geometry_count; i++) {
        const struct canonical_geometry *geometry = &canonical->geometries[i];
        bool once = (geometry->flags & GEOMETRY_NO_DUPLICATE_ANY_HIT) && !(geometry->flags & GEOMETRY_OPAQUE);
        if (geometry->type != GEOMETRY_TRIANGLES || once)
            return false;
    }
    return true;
}

/* Not fminf and fmaxf, which may take either of two zeros. */
static float smaller(float a, float b)
{
    return a < b ? a : b;
}

static float larger(float a, float b)
{
    return a > b ? a : b;
}

static float below(double value)
{
    float rounded = (float)value;
    return (double)rounded > value ? nextafterf(rounded, -INFINITY) : rounded;
}

static float above(double value)
{
    float rounded = (float)value;
    return (double)rounded < value ? nextafterf(rounded, INFINITY) : rounded;
}

static void add_interval(struct box *box, int axis, float low, float high)
{
    box->min[axis] = smaller(low, box->min[axis]);
    box->max[axis] = larger(high, box->max[axis]);
}

/* Where the edge a-b, whose ends are on different sides, meets the plane. The interpolation is off by a few units in the last place. */
static void add_crossing(const float a[3], const float b[3], unsigned axis, float position, struct box sides[2])
{
    double weight = ((double)position - a[axis]) / ((double)b[axis] - a[axis]);
    for (int k = 0; k < 3; k++) {
        double value = a[k] + weight * ((double)b[k] - a[k]), slack = 0x1p-48 * (fabs((double)a[k]) + fabs((double)b[k]));
        float low = k == (int)axis ? position : below(value - slack), high = k == (int)axis ? position : above(value + slack);
        add_interval(&sides[0], k, low, high);
        add_interval(&sides[1], k, low, high);
    }
}

/* `box` cut to `limit`; `limit` itself where nothing would be left, which only rounding can bring about. */
static struct box cut_to(const struct box *box, const struct box *limit)
{
    struct box cut;
    for (int axis = 0; axis < 3; axis++) {
        cut.min[axis] = larger(box->min[axis], limit->min[axis]);
        cut.max[axis] = smaller(box->max[axis], limit->max[axis]);
        if (cut.min[axis] > cut.max[axis]) {
            cut.min[axis] = limit->min[axis];
            cut.max[axis] = limit->max[axis];
        }
    }
    return cut;
}

void clip_primitive(const void *context, const struct primitive_ref *ref, unsigned axis, float position, struct box *ret_left,
                    struct box *ret_right)
{
    const struct canonical *canonical = context;
    const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, ref->id)];
    struct box sides[2] = {box_empty(), box_empty()}, limits[2] = {primitive_ref_box(ref), primitive_ref_box(ref)};
    float corners[3][3];
    canonical_triangle(geometry, ref->id - geometry->first_primitive, corners);
    for (int i = 0; i < 3; i++) {
        const float *a = corners[i], *b = corners[(i + 1) % 3];
        if (a[axis] <= position)
            box_add_point(&sides[0], a);
        if (a[axis] >= position)
            box_add_point(&sides[1], a);
        if ((a[axis] < position && b[axis] > position) || (a[axis] > position && b[axis] < position))
            add_crossing(a, b, axis, position, sides);
    }
    limits[0].max[axis] = limits[1].min[axis] = larger(ref->min[axis], smaller(ref->max[axis], position));
    *ret_left = cut_to(&sides[0], &limits[0]);
    *ret_right = cut_to(&sides[1], &limits[1]);
}
