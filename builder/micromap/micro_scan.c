/* SPDX-License-Identifier: Apache-2.0 */
/* micro_scan.c - visits the rows of cells that a micro-triangle touches. */
#include "builder/micromap/micro_scan.h"

static const unsigned both = ALPHA_PASSES | ALPHA_FAILS;

/* The blocks of one row; most of them do not have to be wrapped. */
static inline unsigned look_at(const struct alpha_cells *cells, unsigned order, int64_t row, int64_t first,
                               int64_t last)
{
    if (first >= 0 && last < cells->axes[0].cells)
        return alpha_cells_run(&cells->orders[order], row, first >> order, last >> order);
    return alpha_cells_wrapped_run(cells, order, row, first, last);
}

/* Looks at all rows of the texture between the leftmost and the rightmost point. */
static unsigned scan_tall(const struct alpha_cells *cells, const struct micro_placed *placed, double pad,
                          unsigned order)
{
    const struct micro_range reach = micro_reach_between(placed, placed->top, placed->bottom, pad);
    unsigned seen = 0;
    for (int64_t row = 0; row < cells->orders[order].height; row++)
        seen |= look_at(cells, order, row, reach.first, reach.last);
    return seen;
}

static inline bool is_uniform(unsigned seen)
{
    return seen == ALPHA_PASSES || seen == ALPHA_FAILS;
}

/* Looks at rows of cells inside the texture. */
static unsigned scan_inside(const struct alpha_cells *cells, const struct micro_placed *placed, const double pad[2],
                            const struct micro_range *rows)
{
    unsigned seen = 0;
    for (int64_t row = rows->first; row <= rows->last; row++) {
        const double y = (double)row;
        const struct micro_range reach = micro_reach_between(placed, y - pad[1], y + 1 + pad[1], pad[0]);
        seen |= look_at(cells, 0, row, reach.first, reach.last);
        if (!is_uniform(seen))
            break;
    }
    return seen;
}

unsigned micro_scan(const struct alpha_cells *cells, const struct texture_triangle *triangle, unsigned level,
                    bool is_upright, const double anchor[2], unsigned order)
{
    const double *pad = triangle->pad;
    const struct micro_grid *grid = &triangle->grids[level];
    const struct micro_placed placed = micro_reach_place(is_upright ? &grid->upright : &grid->turned, anchor);
    const struct micro_range rows = micro_reach_rows(&placed, pad[1]);
    if (grid->is_tall)
        return scan_tall(cells, &placed, pad[0], order);
    if (order == 0 && rows.first >= 0 && rows.last < cells->axes[1].cells)
        return scan_inside(cells, &placed, pad, &rows);
    unsigned seen = 0;
    for (int64_t at = rows.first, next; at <= rows.last && (seen == 0 || is_uniform(seen)); at = next) {
        const int64_t row = texture_axis_block(&cells->axes[1], order, at, &next);
        const struct micro_range reach =
            micro_reach_between(&placed, (double)at - pad[1], (double)next + pad[1], pad[0]);
        seen |= look_at(cells, order, row, reach.first, reach.last);
    }
    return seen;
}

/* The points that are within the pad of a micro-triangle: those in its box and in the half planes beside its edges. */
struct padded {
    double low[2], high[2];
    struct half_plane planes[3];
};

static struct padded padded_of(const struct texture_triangle *triangle, unsigned level, bool is_upright,
                               const double anchor[2])
{
    const struct micro_grid *grid = &triangle->grids[level];
    const double sign = is_upright ? 1 : -1;
    struct padded padded;
    for (int axis = 0; axis < 2; axis++) {
        const double u = sign * grid->step_u[axis], v = sign * grid->step_v[axis];
        const double low = micro_reach_least(0, micro_reach_least(u, v));
        const double high = micro_reach_greatest(0, micro_reach_greatest(u, v));
        padded.low[axis] = anchor[axis] + low - triangle->pad[axis];
        padded.high[axis] = anchor[axis] + high + triangle->pad[axis];
    }
    for (int i = 0; i < 3; i++) {
        const double s = sign * grid->planes[i].s, t = sign * grid->planes[i].t;
        padded.planes[i] = (struct half_plane){s, t, grid->planes[i].limit + s * anchor[0] + t * anchor[1]};
    }
    return padded;
}

/* Returns what bounds of filtered alpha say about the part of a cell that lies in a padded micro-triangle. */
static unsigned bound_cell(const struct alpha_cells *cells, const struct padded *padded, int64_t column, int64_t row)
{
    const struct alpha_patch patch = alpha_patch_make(cells, column, row);
    const double x = (double)column, y = (double)row;
    const double box_low[2] = {padded->low[0] - x, padded->low[1] - y};
    const double box_high[2] = {padded->high[0] - x, padded->high[1] - y};
    struct half_plane planes[3];
    for (int i = 0; i < 3; i++) {
        planes[i] = padded->planes[i];
        planes[i].limit -= planes[i].s * x + planes[i].t * y;
    }
    double low, high;
    if (!alpha_patch_range(&patch, box_low, box_high, planes, &low, &high))
        return 0;
    if (low >= cells->threshold)
        return ALPHA_PASSES;
    return high < cells->threshold ? ALPHA_FAILS : ALPHA_MIXED;
}

unsigned micro_scan_bounds(const struct alpha_cells *cells, const struct texture_triangle *triangle, unsigned level,
                           bool is_upright, const double anchor[2])
{
    const double *pad = triangle->pad;
    const struct micro_grid *grid = &triangle->grids[level];
    const struct micro_placed placed = micro_reach_place(is_upright ? &grid->upright : &grid->turned, anchor);
    const struct micro_range rows = micro_reach_rows(&placed, pad[1]);
    const struct padded padded = padded_of(triangle, level, is_upright, anchor);
    unsigned seen = 0;
    for (int64_t at = rows.first; at <= rows.last; at++) {
        const int64_t row = texture_axis_piece(&cells->axes[1], at).cell;
        const struct micro_range reach =
            micro_reach_between(&placed, (double)at - pad[1], (double)at + 1 + pad[1], pad[0]);
        for (int64_t column = reach.first; column <= reach.last; column++) {
            const int64_t cell = texture_axis_piece(&cells->axes[0], column).cell;
            unsigned set = alpha_cells_run(&cells->orders[0], row, cell, cell);
            if (set == ALPHA_MIXED)
                set = bound_cell(cells, &padded, column, at);
            seen |= set;
            if (seen & ALPHA_MIXED || seen == both)
                return seen;
        }
    }
    return seen;
}

unsigned micro_scan_corners(const struct alpha_cells *cells, const struct texture_triangle *triangle, unsigned level,
                            bool is_upright, const double anchor[2])
{
    const struct micro_grid *grid = &triangle->grids[level];
    const double sign = is_upright ? 1 : -1, *u = grid->step_u, *v = grid->step_v;
    const unsigned passed = (unsigned)alpha_cells_pass(cells, anchor[0], anchor[1]) +
                            (unsigned)alpha_cells_pass(cells, anchor[0] + sign * u[0], anchor[1] + sign * u[1]) +
                            (unsigned)alpha_cells_pass(cells, anchor[0] + sign * v[0], anchor[1] + sign * v[1]);
    return passed == 3 ? ALPHA_PASSES : passed == 0 ? ALPHA_FAILS : ALPHA_PASSES | ALPHA_FAILS;
}
