/* SPDX-License-Identifier: Apache-2.0 */
#include "clip.h"

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
 * Grows both sides by the point where the edge p-q meets the plane, if its ends are on different sides. With u = 2^-24, rounding moves the
 * interpolated point by at most 5 u |q-p|, its sum and the slack's by 2 u of the larger end: less than 8 u (|p| + |q|). On the plane's axis the
 * position is exact.
 */
static inline void grow_by_crossing(struct vec4_box sides[2], vec4 p, vec4 q, unsigned axis, vec4 position, vec4_int on_axis)
{
    if (!((p[axis] < position[0]) & (q[axis] > position[0])) && !((p[axis] > position[0]) & (q[axis] < position[0])))
        return;
    float weight = (position[0] - p[axis]) / (q[axis] - p[axis]);
    vec4 point = p + (q - p) * weight, slack = (vec4_abs(p) + vec4_abs(q)) * 0x1p-21f + FLT_MIN;
    vec4 low = vec4_select(on_axis, position, point - slack), high = vec4_select(on_axis, position, point + slack);
    vec4_box_grow(&sides[0], low, high);
    vec4_box_grow(&sides[1], low, high);
}

/* A corner belongs to the side that it is on, one in the plane to both. */
static inline void grow_by_corner(struct vec4_box sides[2], vec4 corner, unsigned axis, float position)
{
    if (corner[axis] <= position)
        vec4_box_grow(&sides[0], corner, corner);
    if (corner[axis] >= position)
        vec4_box_grow(&sides[1], corner, corner);
}

/* `box` cut to `limit`; on an axis where nothing would be left, which only rounding can bring about, `limit` itself. */
static inline struct vec4_box cut_to(struct vec4_box box, struct vec4_box limit)
{
    vec4 min = vec4_max(box.min, limit.min), max = vec4_min(box.max, limit.max);
    vec4_int good = min <= max;
    return (struct vec4_box){vec4_select(good, min, limit.min), vec4_select(good, max, limit.max)};
}

struct clip_triangle clip_load(const struct canonical *canonical, uint32_t id)
{
    const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
    const uint64_t first = (uint64_t)3 * (id - geometry->first_primitive);
    struct clip_triangle triangle;
    for (unsigned i = 0; i < 3; i++) {
        uint64_t vertex = geometry->indices ? geometry->indices[first + i] : first + i;
        triangle.corners[i] = vec4_load3(geometry->positions + 3 * vertex);
    }
    return triangle;
}

void clip_cut(const struct clip_triangle *triangle, const struct vec4_box *limit, unsigned axis, float position,
              struct vec4_box *ret_left, struct vec4_box *ret_right)
{
    const struct vec4_box old = *limit;
    const vec4 *corners = triangle->corners, plane = vec4_all(position);
    struct vec4_box sides[2] = {vec4_box_empty(), vec4_box_empty()};
    vec4_int on_axis = {axis == 0 ? -1 : 0, axis == 1 ? -1 : 0, axis == 2 ? -1 : 0, 0};
    for (int i = 0; i < 3; i++)
        grow_by_corner(sides, corners[i], axis, position);
    for (int i = 0; i < 3; i++)
        grow_by_crossing(sides, corners[i], corners[i == 2 ? 0 : i + 1], axis, plane, on_axis);
    /* A plane outside of the box leaves all of it on one side, and its face on the other. */
    vec4 cut = vec4_select(on_axis, vec4_max(old.min, vec4_min(old.max, plane)), old.max);
    *ret_left = cut_to(sides[0], (struct vec4_box){old.min, cut});
    *ret_right = cut_to(sides[1], (struct vec4_box){vec4_select(on_axis, cut, old.min), old.max});
}
