/* SPDX-License-Identifier: Apache-2.0 */
/*
 * split.h - divides a set of refs into pieces of bounded size by binned SAH (Wald 2007). Each piece is then built on
 * one thread, and a build can be cancelled between pieces. Refs that no plane separates are halved in their order, so
 * that below such a node the depth is at most log2 of their number.
 */
#ifndef BVHD_SPLIT_H
#define BVHD_SPLIT_H

#include <stdatomic.h>

#include "proto/base/memory.h"
#include "proto/base/status.h"
#include "proto/base/parallel.h"
#include "builder/kernel/primitive_ref.h"

/*
 * A node of the split. Inner nodes have two children at `child` and `child + 1`; pieces have child 0, and refs[first ..
 * first + count).
 */
struct split_node {
    struct box bounds;
    uint32_t first, count;
    uint32_t child;
};

struct split_tree {
    struct split_node *nodes; /* node 0 is the root; children follow their parent */
    uint32_t node_count;
    uint32_t piece_count;
};

struct split_request {
    struct primitive_ref *refs; /* reordered so that each piece is contiguous; magnitudes are at most 2^40 */
    struct primitive_ref *scratch; /* room for as many refs */
    const uint32_t *blocks; /* for scatter_refs: NULL, or the refs lie in block_count blocks with gaps (primitive.h) */
    uint32_t block_count, block_size; /* of `blocks` */
    uint32_t count; /* >= 1 */
    uint32_t piece_size; /* the maximum number of refs in a piece; >= 1 */
    struct box bounds, centroids; /* of all refs (primitive_ref_bounds) */
    const atomic_bool *cancel; /* may be NULL; once set it stays set; checked every few thousand refs */
};

/*
 * Splits the refs on all threads. The caller frees ret_tree->nodes. The result is the same for any number of threads.
 * Returns BVHD_CANCELLED or BVHD_NO_MEMORY; then the refs are in no useful state.
 */
enum bvhd_status split_refs(const struct split_request *request, struct memory *memory, const struct parallel *parallel,
                            struct split_tree *ret_tree, struct bvhd_error *error);

#endif
