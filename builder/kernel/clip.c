/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/kernel/clip.h"

#include <math.h>

#include "proto/base/kind.h"

bool clip_allowed(const struct canonical *canonical)
{
    for (uint32_t i = 0; i < canonical->geometry_count; i++) {
        const struct canonical_geometry *geometry = &canonical->geometries[i];
        bool once = (geometry->flags & GEOMETRY_NO_DUPLICATE_ANY_HIT) && !(geometry->flags & GEOMETRY_OPAQUE);
        if (!kind_find(geometry->type)->can_be_cut || once)
            return false;
    }
    return true;
}

/*
 * Returns the box of the points in which edges cross the plane. With u = 2^-24, rounding moves an interpolated point of
 * an edge from p to q by at most 5 u |q-p|, and the additions of point and slack by 2 u of the larger end: less than 8
 * u (|p| + |q|) together. On the plane's axis the position is exact. Lanes of edges that do not cross hold anything
 * before they are masked.
 */
static inline struct vec4_box crossings(const struct clip_triangle *triangle, unsigned axis, vec4 position,
                                        vec4_int on_axis)
{
    vec4 from = triangle->along[axis], to = vec4_rotate(from), weights = (position - from) / (to - from);
    vec4_int crosses = ((from < position) & (to > position)) | ((from > position) & (to < position));
    struct vec4_box box = vec4_box_empty();
    for (int i = 0; i < 3; i++) {
        vec4 point = triangle->corners[i] + triangle->edges[i] * vec4_all(weights[i]);
        vec4 low = vec4_select(on_axis, position, point - triangle->slacks[i]);
        vec4 high = vec4_select(on_axis, position, point + triangle->slacks[i]);
        vec4_int mask = {crosses[i], crosses[i], crosses[i], crosses[i]};
        vec4_box_grow(&box, vec4_select(mask, low, vec4_all(FLT_MAX)), vec4_select(mask, high, vec4_all(-FLT_MAX)));
    }
    return box;
}

/* Grows the box by the corners that belong to a side; a corner in the plane belongs to both sides. */
static inline void grow_by_corners(struct vec4_box *box, const vec4 corners[3], vec4_int belongs)
{
    for (int i = 0; i < 3; i++) {
        vec4_int mask = {belongs[i], belongs[i], belongs[i], belongs[i]};
        vec4_box_grow(box, vec4_select(mask, corners[i], vec4_all(FLT_MAX)),
                      vec4_select(mask, corners[i], vec4_all(-FLT_MAX)));
    }
}

/*
 * Cuts `box` to `limit`. On an axis where nothing would be left, which only rounding can cause, the result is `limit`.
 */
static inline struct vec4_box cut_to(struct vec4_box box, struct vec4_box limit)
{
    vec4 min = vec4_max(box.min, limit.min), max = vec4_min(box.max, limit.max);
    vec4_int good = min <= max;
    return (struct vec4_box){vec4_select(good, min, limit.min), vec4_select(good, max, limit.max)};
}

struct clip_triangle clip_from_corners(const vec4 corners[3])
{
    struct clip_triangle triangle;
    for (int i = 0; i < 3; i++) {
        vec4 from = corners[i], to = corners[i == 2 ? 0 : i + 1];
        triangle.corners[i] = from;
        triangle.edges[i] = to - from;
        triangle.slacks[i] = (vec4_abs(from) + vec4_abs(to)) * 0x1p-21f + FLT_MIN;
    }
    vec4_transpose3(corners[0], corners[1], corners[2], &triangle.along[0], &triangle.along[1], &triangle.along[2]);
    return triangle;
}

/* Where the plane cuts the old box: outside of it, the whole box is on one side, and its face on the other. */
static inline vec4 cut_of(const struct vec4_box *old, vec4_int on_axis, vec4 plane)
{
    return vec4_select(on_axis, vec4_max(old->min, vec4_min(old->max, plane)), old->max);
}

static inline vec4_int lanes_of(unsigned axis)
{
    return (vec4_int){axis == 0 ? -1 : 0, axis == 1 ? -1 : 0, axis == 2 ? -1 : 0, 0};
}

/* Cuts the boxes of both parts to their sides of the old box. */
static inline void cut_sides(const struct vec4_box sides[2], const struct vec4_box *old, vec4_int on_axis, vec4 plane,
                             struct vec4_box *ret_left, struct vec4_box *ret_right)
{
    const vec4 cut = cut_of(old, on_axis, plane);
    const struct vec4_box limits[2] = {{old->min, cut}, {vec4_select(on_axis, cut, old->min), old->max}};
    *ret_left = cut_to(sides[0], limits[0]);
    *ret_right = cut_to(sides[1], limits[1]);
}

/* Which kinds are cut, and how. */
struct clip_kind {
    void (*load)(const struct canonical_geometry *geometry, uint32_t index, struct clip_shape *ret_shape);
    void (*cut)(const struct clip_shape *shape, const struct vec4_box *limit, unsigned axis, float position,
                struct vec4_box *ret_left, struct vec4_box *ret_right);
};

static void load_triangle(const struct canonical_geometry *geometry, uint32_t index, struct clip_shape *ret_shape)
{
    const uint64_t first = (uint64_t)3 * index;
    vec4 corners[3];
    for (unsigned i = 0; i < 3; i++) {
        uint64_t vertex = geometry->indices ? geometry->indices[first + i] : first + i;
        corners[i] = vec4_load3(geometry->positions + 3 * vertex);
    }
    ret_shape->triangle = clip_from_corners(corners);
}

void clip_cut_triangle(const struct clip_triangle *triangle, const struct vec4_box *limit, unsigned axis,
                       float position, struct vec4_box *ret_left, struct vec4_box *ret_right)
{
    const struct vec4_box old = *limit;
    const vec4 plane = vec4_all(position);
    const vec4_int on_axis = lanes_of(axis);
    struct vec4_box common = crossings(triangle, axis, plane, on_axis), sides[2] = {common, common};
    grow_by_corners(&sides[0], triangle->corners, triangle->along[axis] <= plane);
    grow_by_corners(&sides[1], triangle->corners, triangle->along[axis] >= plane);
    cut_sides(sides, &old, on_axis, plane, ret_left, ret_right);
}

static void cut_triangle(const struct clip_shape *shape, const struct vec4_box *limit, unsigned axis, float position,
                         struct vec4_box *ret_left, struct vec4_box *ret_right)
{
    clip_cut_triangle(&shape->triangle, limit, axis, position, ret_left, ret_right);
}

static void load_swept(const struct canonical_geometry *geometry, uint32_t index, struct clip_shape *ret_shape)
{
    const float *ends = geometry->positions + (uint64_t)4 * (geometry->indices[index] & CANONICAL_END_MASK);
    for (int k = 0; k < 4; k++) {
        ret_shape->swept.from[k] = ends[k];
        ret_shape->swept.along[k] = (double)ends[4 + k] - ends[k];
    }
}

/*
 * Returns the box of the spheres that reach to the lower side of the plane (sign 1) or the upper one (sign -1). Every
 * point on that side lies in one of them, because the shape is within the union of all spheres between both ends. How
 * far the sphere at z reaches towards that side is linear in z, so that these spheres are those on one side of some z,
 * and their box is that of the two at both ends.
 *
 * With u = 2^-53 and the sum m of all magnitudes, `reach` and `step` are off by less than 4 u m. A step below 2^-30 m
 * makes no difference between the spheres; with any other, z in [0, 1] is off by less than (4 + 4 + 2) u 2^30 < 2^-19.
 * The faces are then rounded to floats, by 2^-24 m each, like their slack.
 */
static struct vec4_box part_of(const struct clip_swept *swept, unsigned axis, double sign, float position)
{
    const double *from = swept->from, *along = swept->along;
    const double reach = sign * from[axis] - from[3], step = sign * along[axis] - along[3];
    double m = 0, first = 0, last = 1;
    for (int k = 0; k < 4; k++)
        m += fabs(from[k]) + fabs(along[k]);
    if (fabs(step) > m * 0x1p-30) {
        const double z = (sign * position - reach) / step;
        first = step > 0 ? 0 : fmin(fmax(z - 0x1p-18, 0), 1);
        last = step > 0 ? fmin(fmax(z + 0x1p-18, 0), 1) : 1;
    }
    const float slack = (float)(m * 0x1p-22) + FLT_MIN;
    float min[4] = {0}, max[4] = {0};
    for (int k = 0; k < 3; k++) {
        const double a = from[k] + first * along[k], b = from[k] + last * along[k];
        const double r = from[3] + first * along[3], s = from[3] + last * along[3];
        min[k] = (float)fmin(a - r, b - s) - slack;
        max[k] = (float)fmax(a + r, b + s) + slack;
    }
    return (struct vec4_box){{min[0], min[1], min[2], 0}, {max[0], max[1], max[2], 0}};
}

static void cut_swept(const struct clip_shape *shape, const struct vec4_box *limit, unsigned axis, float position,
                      struct vec4_box *ret_left, struct vec4_box *ret_right)
{
    const struct vec4_box old = *limit;
    const struct vec4_box sides[2] = {part_of(&shape->swept, axis, 1, position),
                                      part_of(&shape->swept, axis, -1, position)};
    cut_sides(sides, &old, lanes_of(axis), vec4_all(position), ret_left, ret_right);
}

static const struct clip_kind kinds[KIND_COUNT] = {
    [KIND_TRIANGLES] = {load_triangle, cut_triangle},
    [KIND_SWEPT_SPHERES] = {load_swept, cut_swept},
};

struct clip_shape clip_load(const struct canonical *canonical, uint32_t id)
{
    const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
    struct clip_shape shape;
    shape.kind = &kinds[kind_find(geometry->type)->number];
    shape.kind->load(geometry, id - geometry->first_primitive, &shape);
    return shape;
}

void clip_cut(const struct clip_shape *shape, const struct vec4_box *limit, unsigned axis, float position,
              struct vec4_box *ret_left, struct vec4_box *ret_right)
{
    shape->kind->cut(shape, limit, axis, position, ret_left, ret_right);
}
