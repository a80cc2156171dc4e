/* SPDX-License-Identifier: Apache-2.0 */
/*
 * clip.h - the boxes of a triangle's parts on both sides of a plane, for spatial splits (Stich 2009).
 *
 * Rounded outward, by 2^-21 of the coordinates, never larger than the part of the old box on that side and never empty:
 * what a ray can meet of the triangle inside the old box lies in one of the two. Magnitudes are at most 2^40
 * (rescale.h).
 */
#ifndef BVHD_CLIP_H
#define BVHD_CLIP_H

#include "builder/format/canonical.h"
#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

/*
 * True when every primitive may be referenced more than once: triangles only, none of a geometry whose any-hit shader
 * must run once.
 */
bool clip_allowed(const struct canonical *canonical);

/* A triangle, to be cut more than once. */
struct clip_triangle {
    vec4 corners[3], edges[3]; /* an edge leads to the next corner */
    vec4 slacks[3]; /* how far off a point of the edge may be */
    vec4 along[3]; /* by axis: of each corner a lane */
};

/* Flat primitive `id` of a canonical that clip_allowed holds for. */
struct clip_triangle clip_load(const struct canonical *canonical, uint32_t id);

/* The parts of the triangle within `limit`, its box or a part of it, below and above `position` on `axis`. */
void clip_cut(const struct clip_triangle *triangle, const struct vec4_box *limit, unsigned axis, float position,
              struct vec4_box *ret_left, struct vec4_box *ret_right);

#endif
