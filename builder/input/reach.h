/* SPDX-License-Identifier: Apache-2.0 */
/* reach.h - finds how far vertices and boxes reach along the directions of slabs (slabs.h). */
#ifndef BVHD_REACH_H
#define BVHD_REACH_H

#include <stddef.h>

#include "builder/kernel/vec4.h"
#include "proto/base/slabs.h"

/*
 * The first slabs of the directions that are sums and differences of an axis and the next one, and of the corners.
 * REACH_GROUPS vectors of lanes hold all directions.
 */
enum { REACH_SUMS = 0, REACH_DIFFERENCES = 3, REACH_CORNERS = 6, REACH_GROUPS = 3 };

struct reach {
    vec4 min[REACH_GROUPS], max[REACH_GROUPS];
};

struct reach reach_empty(void);

/* Grows the reach by vertices of three floats each, or by the active ones of boxes of six. A NaN adds nothing. */
void reach_add_vertices(struct reach *reach, const float *positions, size_t count);
void reach_add_boxes(struct reach *reach, const float *boxes, size_t count);

/*
 * Grows the reach by spheres, given as centre and radius. Nothing is added where one of the four floats is a NaN.
 */
void reach_add_spheres(struct reach *reach, const float *spheres, size_t count);

/* Grows the reach by all that `more` contains. */
void reach_join(struct reach *reach, const struct reach *more);

/* Makes slabs, rounded outward; all 0, which is unknown, for an empty reach or one that does not fit floats. */
struct slabs reach_slabs(const struct reach *reach);

#endif
