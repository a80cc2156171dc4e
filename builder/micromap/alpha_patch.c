/* SPDX-License-Identifier: Apache-2.0 */
/* alpha_patch.c - cuts a triangle to a cell, and searches the extremes of filtered alpha along its edges. */
#include "builder/micromap/alpha_patch.h"

#include <float.h>
#include <string.h>

/*
 * Each of the three cuts of a square adds at most one corner. Rounding can make a polygon slightly concave; but even
 * then a cut adds at most one corner for each two: 4, 6, 9, 13.
 */
enum { CORNERS_MAX = 13 };

struct polygon {
    unsigned count;
    double corners[CORNERS_MAX][2];
};

struct alpha_patch alpha_patch_make(const struct alpha_cells *cells, int64_t column, int64_t row)
{
    const int64_t x = column + cells->axes[0].first_texel, y = row + cells->axes[1].first_texel;
    const int origin = alpha_cells_texel(cells, x, y), right = alpha_cells_texel(cells, x + 1, y);
    const int below = alpha_cells_texel(cells, x, y + 1), across = alpha_cells_texel(cells, x + 1, y + 1);
    return (struct alpha_patch){origin, right - origin, below - origin, origin - right - below + across};
}

/* Keeps the part of a polygon that lies in a half plane. */
static void cut(struct polygon *polygon, const struct half_plane *plane)
{
    double over[CORNERS_MAX];
    bool is_cut = false;
    for (unsigned i = 0; i < polygon->count; i++) {
        over[i] = plane->s * polygon->corners[i][0] + plane->t * polygon->corners[i][1] - plane->limit;
        is_cut |= over[i] > 0;
    }
    if (!is_cut)
        return;
    struct polygon kept;
    kept.count = 0;
    for (unsigned i = 0; i < polygon->count; i++) {
        const unsigned next = i + 1 < polygon->count ? i + 1 : 0;
        const double *from = polygon->corners[i], *to = polygon->corners[next];
        if (over[i] <= 0)
            memcpy(kept.corners[kept.count++], from, sizeof kept.corners[0]);
        if ((over[i] < 0 && over[next] > 0) || (over[i] > 0 && over[next] < 0)) {
            const double share = over[i] / (over[i] - over[next]);
            for (int axis = 0; axis < 2; axis++)
                kept.corners[kept.count][axis] = from[axis] + share * (to[axis] - from[axis]);
            kept.count++;
        }
    }
    *polygon = kept;
}

static double value_at(const struct alpha_patch *patch, double s, double t)
{
    return patch->a + patch->b * s + (patch->c + patch->d * s) * t;
}

/* Adds the extreme of the quadratic that alpha is along an edge, if it lies between the ends. */
static void add_edge(const struct alpha_patch *patch, const double from[2], const double to[2], double *low,
                     double *high)
{
    const double s = to[0] - from[0], t = to[1] - from[1];
    const double quadratic = patch->d * s * t;
    if (quadratic == 0)
        return;
    const double linear = patch->b * s + patch->c * t + patch->d * (from[0] * t + from[1] * s);
    const double share = linear / (-2 * quadratic);
    if (!(share > 0 && share < 1))
        return;
    const double value = value_at(patch, from[0] + share * s, from[1] + share * t);
    *low = value < *low ? value : *low;
    *high = value > *high ? value : *high;
}

bool alpha_patch_range(const struct alpha_patch *patch, const double box_low[2], const double box_high[2],
                       const struct half_plane planes[3], double *ret_low, double *ret_high)
{
    const double left = box_low[0] > 0 ? box_low[0] : 0, right = box_high[0] < 1 ? box_high[0] : 1;
    const double top = box_low[1] > 0 ? box_low[1] : 0, bottom = box_high[1] < 1 ? box_high[1] : 1;
    if (!(left <= right && top <= bottom))
        return false;
    struct polygon polygon = {.count = 4, .corners = {{left, top}, {right, top}, {right, bottom}, {left, bottom}}};
    for (int i = 0; i < 3; i++)
        cut(&polygon, &planes[i]);
    if (polygon.count == 0)
        return false;
    double low = DBL_MAX, high = -DBL_MAX;
    for (unsigned i = 0; i < polygon.count; i++) {
        const double *from = polygon.corners[i], *to = polygon.corners[i + 1 < polygon.count ? i + 1 : 0];
        const double value = value_at(patch, from[0], from[1]);
        low = value < low ? value : low;
        high = value > high ? value : high;
        add_edge(patch, from, to, &low, &high);
    }
    *ret_low = low - 0x1p-10;
    *ret_high = high + 0x1p-10;
    return true;
}
