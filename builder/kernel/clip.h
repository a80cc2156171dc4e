/* SPDX-License-Identifier: Apache-2.0 */
/*
 * clip.h - cuts a primitive's box at a plane into the boxes of the parts on both sides, for spatial splits (Stich
 * 2009).
 *
 * The boxes are rounded outward, by 2^-21 of the coordinates. Neither is larger than the part of the old box on its
 * side, and neither is empty. Every point of the primitive in the old box that a ray can meet lies in one of the two.
 * Magnitudes are at most 2^40 (rescale.h). Triangles and linear swept spheres can be cut: long, thin things whose boxes
 * are large.
 */
#ifndef BVHD_CLIP_H
#define BVHD_CLIP_H

#include "builder/format/canonical.h"
#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

/*
 * True when every primitive may be referenced more than once: all are of a kind that can be cut (kind.h), and none
 * belongs to a geometry whose any-hit shader must run only once (NO_DUPLICATE_ANY_HIT without OPAQUE).
 */
bool clip_allowed(const struct canonical *canonical);

/* A triangle, and a linear swept sphere, loaded for one or several cuts. */
struct clip_triangle {
    vec4 corners[3], edges[3]; /* edges[i] leads from corner i to the next one */
    vec4 slacks[3]; /* how far off a computed point of each edge may be */
    vec4 along[3]; /* corners by axis, one lane for each corner */
};

struct clip_swept {
    double from[4], along[4]; /* the first end, and what leads to the second one */
};

struct clip_shape {
    const struct clip_kind *kind; /* clip.c */
    union {
        struct clip_triangle triangle;
        struct clip_swept swept;
    };
};

/* Returns the triangle with these corners, whose fourth lanes are 0. */
struct clip_triangle clip_from_corners(const vec4 corners[3]);

/* Loads primitive `id`, numbered over all geometries, of a canonical copy for which clip_allowed is true. */
struct clip_shape clip_load(const struct canonical *canonical, uint32_t id);

/*
 * Computes the boxes of the primitive's parts below and above `position` on `axis`. `limit` is the primitive's box or a
 * part of it; both results lie inside.
 */
void clip_cut(const struct clip_shape *shape, const struct vec4_box *limit, unsigned axis, float position,
              struct vec4_box *ret_left, struct vec4_box *ret_right);

/* The same for a triangle from corners. */
void clip_cut_triangle(const struct clip_triangle *triangle, const struct vec4_box *limit, unsigned axis,
                       float position, struct vec4_box *ret_left, struct vec4_box *ret_right);

#endif
