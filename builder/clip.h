/* SPDX-License-Identifier: Apache-2.0 */
/*
 * clip.h - the boxes of a triangle's parts on both sides of a plane, for spatial splits (Stich 2009).
 *
 * Rounded outward, by 2^-21 of the coordinates, never larger than the part of the old box on that side and never empty: what a ray can meet of
 * the triangle inside the old box lies in one of the two. Magnitudes are at most 2^40 (rescale.h).
 */
#ifndef BVHD_CLIP_H
#define BVHD_CLIP_H

#include "canonical.h"
#include "primitive.h"

/* True when every primitive may be referenced more than once: triangles only, none of a geometry whose any-hit shader must run once. */
bool clip_allowed(const struct canonical *canonical);

/* An embree_split_function; `context` is the struct canonical that the ref's id is from. Needs clip_allowed. */
void clip_primitive(const void *context, const struct primitive_ref *ref, unsigned axis, float position, struct box *ret_left,
                    struct box *ret_right);

#endif
