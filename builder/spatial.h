/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spatial.h - the builder of quality high: a piece's tree by binned SAH with spatial splits (SBVH, Stich 2009), on one thread.
 *
 * As binned.h, but where the best division of a node leaves two boxes that overlap, a plane that cuts triangles in two is tried as well. Cut
 * triangles are referenced from both sides; their number is bounded.
 */
#ifndef BVHD_SPATIAL_H
#define BVHD_SPATIAL_H

#include <stdatomic.h>

#include "canonical.h"
#include "ir.h"
#include "primitive.h"

struct spatial_request {
    const struct canonical *canonical; /* clip_allowed; refs are its triangles */
    const struct primitive_ref *refs; /* each id once */
    uint32_t count; /* >= 1 */
    uint32_t leaf_max; /* >= 1; a node of so many refs or fewer is a leaf */
    const atomic_bool *cancel; /* may be NULL; looked at before each node */
    float whole; /* half the area of the structure that the piece is a part of: overlaps small beside it do not matter */
};

/* Most refs of a tree over `count`: three tenths more. */
uint32_t spatial_capacity(uint32_t count);

/*
 * Magnitudes are at most 2^40. *ret_ir is made by ir_init from `memory`, with at most spatial_capacity(count) refs; no leaf names an id twice.
 * BVHD_CANCELLED, BVHD_NO_MEMORY.
 */
enum bvhd_status spatial_build(const struct spatial_request *request, struct memory *memory, struct ir *ret_ir,
                               struct bvhd_error *error);

#endif
