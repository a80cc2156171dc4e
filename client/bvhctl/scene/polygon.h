/* SPDX-License-Identifier: Apache-2.0 */
/*
 * polygon.h - cuts polygons into triangles by clipping ears, for readers of scene files.
 *
 * A polygon of n corners gives n - 2 triangles, whatever its shape: convex, concave, with repeated or straight corners,
 * not planar, or with NaN in it. The order of triangles is the order of assimp 5.2. A quad is a fan from its first
 * corner, or from its concave one. Of a larger polygon ears are cut from corner 0 on, so that a convex one becomes a
 * fan from its last corner.
 */
#ifndef BVHCTL_POLYGON_H
#define BVHCTL_POLYGON_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

/* A corner of the polygon that is being cut. */
struct polygon_corner {
    double x, y; /* in the plane of the polygon; counter-clockwise polygons have a positive area */
    uint32_t previous, next; /* corners that are not cut off yet */
    bool is_reflex; /* the inner angle exceeds 180 degrees */
    bool is_cut; /* it was the tip of an ear */
};

/* Cuts polygons one after the other. It keeps memory for the next one, and limits the time of the search for ears. */
struct polygon_cutter {
    struct memory *memory;
    struct polygon_corner *corners;
    uint32_t *reflex; /* the corners that were reflex at the start */
    uint32_t capacity, reflex_count;
    uint64_t tests; /* of points in ears that are left */
};

/* Prepares a cutter. End with polygon_cutter_finish. */
void polygon_cutter_init(struct polygon_cutter *cutter, struct memory *memory);

/*
 * Writes the (count - 2) * 3 vertices of the triangles. `vertices` are the `count` >= 3 vertices of the polygon, which
 * are rows of `positions`. *ret_is_fanned becomes true when no ear was left to cut, as in a polygon that crosses
 * itself, or when the search took too long: the remaining triangles are a fan then. The time of all polygons is at most
 * a second, and more in proportion to their corners. Returns false when there is no memory.
 */
bool polygon_cut(struct polygon_cutter *cutter, const float *positions, const uint32_t *vertices, uint32_t count,
                 uint32_t *ret_triangles, bool *ret_is_fanned);

/* NULL-safe, idempotent. */
void polygon_cutter_finish(struct polygon_cutter *cutter);

#endif
