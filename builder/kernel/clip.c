/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/kernel/clip.h"

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

struct clip_triangle clip_load(const struct canonical *canonical, uint32_t id)
{
    const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
    const uint64_t first = (uint64_t)3 * (id - geometry->first_primitive);
    vec4 corners[3];
    for (unsigned i = 0; i < 3; i++) {
        uint64_t vertex = geometry->indices ? geometry->indices[first + i] : first + i;
        corners[i] = vec4_load3(geometry->positions + 3 * vertex);
    }
    return clip_from_corners(corners);
}

void clip_cut(const struct clip_triangle *triangle, const struct vec4_box *limit, unsigned axis, float position,
              struct vec4_box *ret_left, struct vec4_box *ret_right)
{
    const struct vec4_box old = *limit;
    vec4 plane = vec4_all(position);
    vec4_int on_axis = {axis == 0 ? -1 : 0, axis == 1 ? -1 : 0, axis == 2 ? -1 : 0, 0};
    struct vec4_box common = crossings(triangle, axis, plane, on_axis), sides[2] = {common, common};
    grow_by_corners(&sides[0], triangle->corners, triangle->along[axis] <= plane);
    grow_by_corners(&sides[1], triangle->corners, triangle->along[axis] >= plane);
    /* A plane outside of the box leaves the whole box on one side, and its face on the other. */
    vec4 cut = vec4_select(on_axis, vec4_max(old.min, vec4_min(old.max, plane)), old.max);
    *ret_left = cut_to(sides[0], (struct vec4_box){old.min, cut});
    *ret_right = cut_to(sides[1], (struct vec4_box){vec4_select(on_axis, cut, old.min), old.max});
}
