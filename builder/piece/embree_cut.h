/* SPDX-License-Identifier: Apache-2.0 */
/*
 * embree_cut.h - the coordinates in which Embree sees a piece, and cuts of triangles in them for spatial splits.
 *
 * A piece is moved to the origin and scaled by a power of two, so that magnitudes are at most about 1: areas then
 * neither overflow nor vanish, and a piece far from the origin keeps its precision.
 *
 * Embree 3.13 asserts that a spatial split leaves refs on both sides. It places a ref by the bin of its centre but cuts
 * at the position of a plane, and the two are rounded differently, by at most 2^-20 in these coordinates. So a side
 * could stay empty where a ref, or a part of one, is hardly thicker than that. Here no ref is: on each axis its
 * thickness is 0 or at least EMBREE_THICKNESS, and a cut that would leave less on a side is refused. Then the ref
 * belongs to the side of its centre; it counts for neither side in the search for a plane where its centre is as good
 * as on the plane.
 */
#ifndef BVHD_EMBREE_CUT_H
#define BVHD_EMBREE_CUT_H

#include "builder/format/canonical.h"
#include "builder/kernel/primitive_ref.h"

#define EMBREE_THICKNESS 0x1p-16f

struct embree_space {
    double centre[3];
    double scale, unscale; /* to the space, and back; their product is 1 */
};

/* Returns the space for refs with these bounds, which are not empty. */
struct embree_space embree_space_for(const struct box *bounds);

/* Returns a box in the space. Its coordinates are rounded to nearest. */
struct box embree_space_box(const struct embree_space *space, const struct box *box);

/* Makes each side of a box of the space that is thinner than EMBREE_THICKNESS but not 0 as thick as that. */
void embree_space_thicken(struct box *box);

/* A triangle in the space, for cuts. */
struct embree_triangle {
    float corners[3][3];
    float error; /* how far off a point of it may be, by rounding */
};

/* Returns primitive `id` of a canonical copy for which clip_allowed is true (clip.h). */
struct embree_triangle embree_triangle_load(const struct embree_space *space, const struct canonical *canonical,
                                            uint32_t id);

/*
 * Cuts a part of the triangle, a box in the space, at `position` on `axis`. Each result is empty or lies in `part`;
 * together they hold all of the triangle that `part` does, up to its error, or both are empty.
 */
void embree_cut(const struct embree_triangle *triangle, const struct box *part, unsigned axis, float position,
                struct box *ret_left, struct box *ret_right);

/* Returns a part of the triangle in the scene's coordinates, rounded outward by more than it may be off. */
struct box embree_cut_outward(const struct embree_space *space, const struct embree_triangle *triangle,
                              const struct box *part);

#endif
