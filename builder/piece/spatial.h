/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spatial.h - builds a piece's tree for quality high, on one thread: binned SAH with spatial splits (SBVH, Stich 2009).
 * A TLAS of quality balanced is built by it too, without splits.
 *
 * Refs are divided by their centroids. Where that leaves two boxes that overlap, a plane that cuts triangles in two is
 * tried as well, unless such planes have hardly ever paid in nodes of about this size. Cut triangles are referenced
 * from both sides; their number is limited by the room, and each additional ref has to save more than its price.
 */
#ifndef BVHD_SPATIAL_H
#define BVHD_SPATIAL_H

#include <stdatomic.h>

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "builder/kernel/primitive_ref.h"

struct spatial_request {
    /* used when capacity > count: clip_allowed holds, and the refs are its triangles or parts of them */
    const struct canonical *canonical;
    /* room for `capacity` refs each; `refs` holds the first `count`; their contents afterwards have no meaning */
    struct primitive_ref *refs, *scratch;
    uint32_t count, capacity; /* 1 <= count <= capacity; the tree has at most `capacity` refs */
    const atomic_bool *cancel; /* may be NULL; checked every few hundred refs */
    float price; /* what an additional ref has to save (spatial_price) */
};

/*
 * Returns the `capacity` to choose for `count` refs: two fifths more than `count`, or just `count` (which means no
 * splits) where that would exceed 2^31 - 1.
 */
uint32_t spatial_capacity(uint32_t count);

/*
 * Builds the tree. Magnitudes are at most 2^40. *ret_ir is allocated from `memory`, and the caller ends it with
 * ir_finish. Each leaf holds one ref, and parts of one triangle may be siblings. Returns BVHD_NO_MEMORY or
 * BVHD_CANCELLED.
 */
enum bvhd_status spatial_build(const struct spatial_request *request, struct memory *memory, struct ir *ret_ir,
                               struct bvhd_error *error);

#endif
