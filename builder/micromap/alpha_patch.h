/* SPDX-License-Identifier: Apache-2.0 */
/*
 * alpha_patch.h - bounds of bilinearly filtered alpha within a part of a cell (texture_axis.h).
 *
 * Coordinates are relative to the cell, which is the unit square. There filtered alpha is a + b s + c t + d s t, whose
 * extremes over a polygon lie on its edges.
 */
#ifndef BVHD_ALPHA_PATCH_H
#define BVHD_ALPHA_PATCH_H

#include "builder/micromap/alpha_cells.h"

struct alpha_patch {
    double a, b, c, d; /* alpha from 0 to 255 */
};

/* The points with s * x + t * y <= limit. */
struct half_plane {
    double s, t, limit;
};

/* Makes the patch of a cell; its numbers may lie outside the texture. */
struct alpha_patch alpha_patch_make(const struct alpha_cells *cells, int64_t column, int64_t row);

/*
 * Computes the extremes of filtered alpha over the part of the cell that lies in a box and in three half planes, and
 * 2^-10 more on either side for rounding. Returns false if there is no such part.
 */
bool alpha_patch_range(const struct alpha_patch *patch, const double box_low[2], const double box_high[2],
                       const struct half_plane planes[3], double *ret_low, double *ret_high);

#endif
