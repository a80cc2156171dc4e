/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spatial.h - the builder of quality high: a piece's tree by binned SAH with spatial splits (SBVH, Stich 2009), on one
 * thread.
 *
 * Refs are divided by their centroids. Where that leaves two boxes that overlap, a plane that cuts triangles in two is
 * tried as well, unless hardly any such plane was good in nodes of about the size before. Cut triangles are referenced
 * from both sides; their number is bounded by the room there is, and each has to pay for itself.
 */
#ifndef BVHD_SPATIAL_H
#define BVHD_SPATIAL_H

#include <stdatomic.h>

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "builder/kernel/primitive_ref.h"

struct spatial_request {
    /* when there is room: clip_allowed, and refs are its triangles or parts of them */
    const struct canonical *canonical;
    struct primitive_ref *refs,
        *scratch; /* `capacity` each; the refs are the first `count`; what they hold afterwards is of no use */
    uint32_t count, capacity; /* 1 <= count <= capacity: no tree has more refs than that */
    const atomic_bool *cancel; /* may be NULL; looked at every few hundred refs */
    float price; /* what a ref more has to save (spatial_bins.h) */
};

/* Room for the refs of a tree over `count`: two fifths more. */
uint32_t spatial_capacity(uint32_t count);

/*
 * Magnitudes are at most 2^40. *ret_ir is made by ir_init from `memory`; each leaf holds one ref, and one triangle's
 * parts may be siblings. BVHD_CANCELLED, BVHD_NO_MEMORY.
 */
enum bvhd_status spatial_build(const struct spatial_request *request, struct memory *memory, struct ir *ret_ir,
                               struct bvhd_error *error);

#endif
