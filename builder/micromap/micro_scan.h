/* SPDX-License-Identifier: Apache-2.0 */
/*
 * micro_scan.h - what an alpha test decides in a micro-triangle of a triangle that lies in a texture.
 *
 * All coordinates are in cells (texture_axis.h). Answers are certain for every point of the micro-triangle, and for the
 * points beside it that are at most `pad` away from it in each direction: a shader computes its texture coordinates in
 * floats, and samplers round them.
 */
#ifndef BVHD_MICRO_SCAN_H
#define BVHD_MICRO_SCAN_H

#include "builder/format/micro_triangle.h"
#include "builder/micromap/alpha_cells.h"
#include "builder/micromap/alpha_patch.h"
#include "builder/micromap/micro_reach.h"

/* The micro-triangles of one level. */
struct micro_grid {
    double step_u[2], step_v[2]; /* one part of the edges from the first corner to the second and to the third */
    struct half_plane planes[3]; /* that an upright one with its pad lies in, relative to its anchor */
    struct micro_shape upright, turned; /* turned: standing on its corner, anchored at its larger u and v */
    unsigned order; /* of blocks that tests at inner levels look at */
    unsigned order_last; /* and tests at the last level */
    bool is_tall; /* higher than a period of the texture: only its columns are looked at */
    bool may_bound; /* small enough to bound filtered alpha in each cell */
};

/* A triangle in a texture. */
struct texture_triangle {
    double corner[2], edge_u[2], edge_v[2]; /* the first corner, and from there to the second and to the third */
    double pad[2];
    bool is_everywhere; /* not located: coordinates too large for floats to tell texels apart, or no numbers */
    struct micro_grid grids[MICRO_LEVEL_MAX + 1];
};

/*
 * Places a triangle, of three pairs (s, t) of texture coordinates, which may be any floats. `extra` says how far
 * the coordinates of a sampler may be from exact ones, beyond 2^-20 of the largest coordinate of the triangle; it is
 * at least 0.
 */
void texture_triangle_init(const struct alpha_cells *cells, const float coordinates[3][2], const float extra[2],
                           unsigned last_level, struct texture_triangle *ret_triangle);

/* Returns whether any of the corners, and whether another, passes the test: a set as below. */
unsigned micro_scan_corners(const struct alpha_cells *cells, const struct texture_triangle *triangle, unsigned level,
                            bool is_upright, const double anchor[2]);

/* Returns the anchor of a micro-triangle: i and j are its u and v, in parts of the edges. */
static inline void texture_triangle_anchor(const struct texture_triangle *triangle, unsigned level, uint32_t i,
                                           uint32_t j, double ret_at[2])
{
    const struct micro_grid *grid = &triangle->grids[level];
    for (int axis = 0; axis < 2; axis++)
        ret_at[axis] = triangle->corner[axis] + i * grid->step_u[axis] + j * grid->step_v[axis];
}

/*
 * Returns the set of what the test decides in cells that a micro-triangle touches: ALPHA_PASSES alone and ALPHA_FAILS
 * alone are certain for all of it, other sets decide nothing and may lack bits. It looks at blocks of 2^order cells.
 */
unsigned micro_scan(const struct alpha_cells *cells, const struct texture_triangle *triangle, unsigned level,
                    bool is_upright, const double anchor[2], unsigned order);

/*
 * Returns such a set, too, but computes bounds of filtered alpha in the part of each mixed cell that lies in the
 * micro-triangle. It is for grids that may_bound, and costs some times as much.
 */
unsigned micro_scan_bounds(const struct alpha_cells *cells, const struct texture_triangle *triangle, unsigned level,
                           bool is_upright, const double anchor[2]);

#endif
