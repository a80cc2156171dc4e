/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spatial_split.h - the top of a build with spatial splits, for quality high: divides the triangles into pieces by the
 * same method that spatial.h uses within each piece, with all threads working on one node at a time.
 */
#ifndef BVHD_SPATIAL_SPLIT_H
#define BVHD_SPATIAL_SPLIT_H

#include <stdatomic.h>

#include "builder/format/canonical.h"
#include "builder/top/split.h"

struct spatial_split_request {
    const struct canonical *canonical; /* clip_allowed holds for it; only read when capacity > count */
    struct primitive_ref *refs, *scratch; /* room for `capacity` refs each; `refs` holds the first `count` */
    uint32_t count, capacity; /* 1 <= count <= capacity */
    uint32_t piece_size; /* the maximum number of refs in a piece; >= 1 */
    struct box bounds, centroids; /* of all refs (primitive_ref_bounds); magnitudes are at most 2^40 */
    const atomic_bool *cancel; /* may be NULL; once set it stays set; checked every few thousand refs */
};

/*
 * Does what split_refs does, except that cut triangles are referenced from both sides, and that each piece has room for
 * more: its refs are refs[first .. first + count), and both arrays belong to it up to the `first` of the next piece. No
 * bounds are set; the root's count is the sum over the pieces. If a few refs are about as large as the whole scene
 * (outsize refs), they would enlarge the box of every node above them, so they form a separate piece directly below the
 * root. *ret_price is the spatial_price of the other refs.
 *
 * The caller frees ret_tree->nodes. Returns BVHD_CANCELLED or BVHD_NO_MEMORY.
 */
enum bvhd_status spatial_split(const struct spatial_split_request *request, struct memory *memory,
                               const struct parallel *parallel, struct split_tree *ret_tree, float *ret_price,
                               struct bvhd_error *error);

#endif
