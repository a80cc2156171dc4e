/* SPDX-License-Identifier: Apache-2.0 */
/* texture_triangle.c - places a triangle in a texture, and prepares the micro-triangles of each level. */
#include <math.h>

#include "builder/micromap/micro_scan.h"

/*
 * The rows of cells or blocks that a test looks at are at most so many, at inner levels and at the last, and the
 * columns at most COLUMNS_MAX.
 */
enum { ROWS_INNER = 16, ROWS_LAST = 128, COLUMNS_MAX = 256 };

/*
 * A shader computes w a + u b + v c, or a + u (b - a) + v (c - a), in floats: for numbers up to m, the roundings of the
 * one add up to 4 times 2^-24 m, and those of the other to 8 times. The choice of the micro-triangle and the sampler's
 * product with the size add one each. That makes less than 2^-20 m. From 2^20 on this exceeds the texture.
 */
static const double rounding_share = 0x1p-20, coordinate_max = 0x1p20;

/* Samplers of devices compute with 8 bits behind the point, and may round either way. */
static const double sampler_pad = 0x1p-8;

/* Corners are moved by less than an eighth of the pad (make_shape), which is that much larger. */
static const double pad_scale = 1.25;

struct corner {
    double x, y;
};

static void sort_two(struct corner *a, struct corner *b)
{
    if (a->y > b->y) {
        const struct corner kept = *a;
        *a = *b;
        *b = kept;
    }
}

/* Makes the box of corners that ascend in y. */
static struct micro_shape box_of(const struct corner corners[3])
{
    const double left = fmin(corners[0].x, fmin(corners[1].x, corners[2].x));
    const double right = fmax(corners[0].x, fmax(corners[1].x, corners[2].x));
    return (struct micro_shape){.side = 1, .top = corners[0].y, .bottom = corners[2].y, .x = {left, right}};
}

/* Returns the slope of an edge; one without height goes far, to the side where it is not in the way. */
static double slope_of(const struct corner *from, const struct corner *to, double level)
{
    return to->y > from->y ? (to->x - from->x) / (to->y - from->y) : level;
}

/* Makes the shape with corners that ascend in y; a and c are not at the same height. */
static struct micro_shape shape_of(struct corner a, struct corner b, struct corner c)
{
    const double slope = slope_of(&a, &c, 0), side = b.x < a.x + slope * (b.y - a.y) ? -1 : 1;
    a.x *= side;
    b.x *= side;
    c.x *= side;
    const double slope_ac = side * slope, slope_ab = slope_of(&a, &b, 1e30), slope_bc = slope_of(&b, &c, -1e30);
    return (struct micro_shape){
        .side = side,
        .top = a.y,
        .bottom = c.y,
        .x = {a.x, b.x},
        .y = {a.y, b.y},
        .slopes = {slope_ac, slope_ab},
        .other_slopes = {slope_ac, slope_bc},
        .outermost = {slope_ac >= 0 ? a.y : c.y, slope_ab <= 0   ? a.y
                                                 : slope_bc >= 0 ? c.y
                                                                 : b.y},
    };
}

/*
 * Makes the micro-triangle with corners 0, u and v, or their negatives. Places along y are rounded by less than 2^-28
 * of the pad. So that slopes do not magnify that, edges are at least `height` high, an eighth of the pad, or not at
 * all: the middle corner moves to the other's height, and a flat shape becomes its box.
 */
static struct micro_shape make_shape(const double u[2], const double v[2], double sign, double height)
{
    struct corner corners[3] = {{0, 0}, {sign * u[0], sign * u[1]}, {sign * v[0], sign * v[1]}};
    sort_two(&corners[0], &corners[1]);
    sort_two(&corners[1], &corners[2]);
    sort_two(&corners[0], &corners[1]);
    if (corners[2].y - corners[0].y < 2 * height)
        return box_of(corners);
    if (corners[1].y - corners[0].y < height)
        corners[1].y = corners[0].y;
    if (corners[2].y - corners[1].y < height)
        corners[1].y = corners[2].y;
    return shape_of(corners[0], corners[1], corners[2]);
}

/* Sets the half planes beside the edges, moved outward by the pad. Their scale, that of the edges, does not matter. */
static void set_planes(const double u[2], const double v[2], const double pad[2], struct half_plane planes[3])
{
    const double corners[3][2] = {{0, 0}, {u[0], u[1]}, {v[0], v[1]}};
    const double turn = u[0] * v[1] - u[1] * v[0] < 0 ? -1 : 1;
    for (int i = 0; i < 3; i++) {
        const double *from = corners[i], *to = corners[(i + 1) % 3];
        const double s = turn * (to[1] - from[1]), t = turn * (from[0] - to[0]);
        planes[i] = (struct half_plane){s, t, s * from[0] + t * from[1] + fabs(s) * pad[0] + fabs(t) * pad[1]};
    }
}

/* Returns the least order in which so many cells are at most `most` blocks. */
static unsigned order_of(const struct alpha_cells *cells, double rows, double columns, double rows_max)
{
    unsigned order = 0;
    while (order + 1 < cells->order_count &&
           (ldexp(rows, -(int)order) > rows_max || ldexp(columns, -(int)order) > COLUMNS_MAX))
        order++;
    return order;
}

static void make_grid(const struct alpha_cells *cells, const struct texture_triangle *triangle, unsigned level,
                      struct micro_grid *grid)
{
    double extent[2], looked_at[2];
    for (int axis = 0; axis < 2; axis++) {
        const double u = ldexp(triangle->edge_u[axis], -(int)level), v = ldexp(triangle->edge_v[axis], -(int)level);
        grid->step_u[axis] = u;
        grid->step_v[axis] = v;
        extent[axis] = fmax(0, fmax(u, v)) - fmin(0, fmin(u, v)) + 2 * triangle->pad[axis];
        looked_at[axis] = fmin(extent[axis], (double)cells->axes[axis].cells);
    }
    grid->upright = make_shape(grid->step_u, grid->step_v, 1, triangle->pad[1] / 8);
    grid->turned = make_shape(grid->step_u, grid->step_v, -1, triangle->pad[1] / 8);
    set_planes(grid->step_u, grid->step_v, triangle->pad, grid->planes);
    grid->order = order_of(cells, looked_at[1], looked_at[0], ROWS_INNER);
    grid->order_last = order_of(cells, looked_at[1], looked_at[0], ROWS_LAST);
    grid->is_tall = cells->axes[1].period > 0 && extent[1] >= (double)cells->axes[1].period;
    grid->may_bound = cells->may_bound && !grid->is_tall && extent[1] > 2.25 * triangle->pad[1] &&
                      grid->order_last == 0 && extent[1] <= ROWS_LAST && extent[0] <= COLUMNS_MAX &&
                      fmax(triangle->pad[0], triangle->pad[1]) < 0.25;
}

void texture_triangle_init(const struct alpha_cells *cells, const float coordinates[3][2], const float extra[2],
                           unsigned last_level, struct texture_triangle *ret_triangle)
{
    ret_triangle->is_everywhere = false;
    for (int axis = 0; axis < 2; axis++) {
        const struct texture_axis *along = &cells->axes[axis];
        const double size = (double)along->texels;
        double at[3], most = 0;
        for (int corner = 0; corner < 3; corner++) {
            const double coordinate = (double)coordinates[corner][axis];
            ret_triangle->is_everywhere |= !(fabs(coordinate) < coordinate_max);
            most = fmax(most, fabs(coordinate));
            at[corner] = coordinate * size + along->shift;
        }
        ret_triangle->pad[axis] = pad_scale * ((most * rounding_share + (double)extra[axis]) * size + sampler_pad);
        /* A difference of whole periods is exact, and brings most triangles to where nothing has to be wrapped. */
        const double period = (double)along->period;
        const double low = fmin(at[0], fmin(at[1], at[2]));
        ret_triangle->corner[axis] = at[0] - (period > 0 ? floor(low / period) * period : 0);
        ret_triangle->edge_u[axis] = at[1] - at[0];
        ret_triangle->edge_v[axis] = at[2] - at[0];
        for (int corner = 0; corner < 3; corner++)
            ret_triangle->is_everywhere |=
                !(fabs(ret_triangle->corner[axis]) + fabs(at[corner] - at[0]) + ret_triangle->pad[axis] <
                  MICRO_REACH_MAX);
    }
    for (unsigned level = 0; level <= last_level && !ret_triangle->is_everywhere; level++)
        make_grid(cells, ret_triangle, level, &ret_triangle->grids[level]);
}
