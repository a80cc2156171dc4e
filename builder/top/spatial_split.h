/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spatial_split.h - the top of a build with spatial splits: cuts the triangles into pieces as spatial.h goes on within
 * each, all threads at one node together.
 */
#ifndef BVHD_SPATIAL_SPLIT_H
#define BVHD_SPATIAL_SPLIT_H

#include <stdatomic.h>

#include "builder/format/canonical.h"
#include "builder/top/split.h"

struct spatial_split_request {
    const struct canonical *canonical; /* clip_allowed */
    struct primitive_ref *refs, *scratch; /* `capacity` each; the refs are the first `count` */
    uint32_t count, capacity; /* 1 <= count <= capacity */
    uint32_t piece_size; /* no piece is larger; >= 1 */
    struct box bounds, centroids; /* of all refs (primitive_ref_bounds); magnitudes of at most 2^40 */
    const atomic_bool *cancel; /* may be NULL; once set it stays set; looked at every few thousand refs */
};

/*
 * As split_refs, but cut triangles are referenced from both sides, and each piece has room: its refs are refs[first ..
 * first + count), and both arrays are its own up to the `first` of the piece behind it. No bounds are set; the root's
 * count is that of the pieces' refs. Refs about as large as the whole, which would blow up every box on their way down,
 * make a piece of their own below the root; *ret_price is spatial_price of the others.
 */
enum bvhd_status spatial_split(const struct spatial_split_request *request, struct memory *memory,
                               const struct parallel *parallel, struct split_tree *ret_tree, float *ret_price,
                               struct bvhd_error *error);

#endif
