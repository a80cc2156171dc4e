/* SPDX-License-Identifier: Apache-2.0 */
/*
 * split.h - our own binned SAH splitting (Wald 2007), which cuts a set of refs into pieces.
 *
 * Used above all builders, to make pieces of bounded size so that a build can be cancelled, shared out and take turns.
 * Where nothing separates the refs they are halved in their order, so the depth stays within log2 of the count there.
 */
#ifndef BVHD_SPLIT_H
#define BVHD_SPLIT_H

#include <stdatomic.h>

#include "proto/base/memory.h"
#include "proto/base/status.h"
#include "proto/base/parallel.h"
#include "builder/kernel/primitive_ref.h"

/*
 * A node of the cut: inner nodes have two children at `child` and `child + 1`, pieces have child 0 and refs[first ..
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
    struct primitive_ref *refs; /* permuted so that each piece is contiguous; magnitudes of at most 2^40 */
    struct primitive_ref *scratch; /* room for as many */
    const uint32_t *blocks; /* with scatter_refs: NULL, or refs lie in block_count blocks (primitive.h) */
    uint32_t block_count;
    uint32_t count; /* >= 1 */
    uint32_t piece_size; /* no piece is larger; >= 1 */
    struct box bounds, centroids; /* of all refs (primitive_ref_bounds) */
    const atomic_bool *cancel; /* may be NULL; once set it stays set; looked at every few thousand refs */
};

/*
 * The caller frees ret_tree->nodes. The same for any number of threads. BVHD_CANCELLED, BVHD_NO_MEMORY: refs are in no
 * useful state.
 */
enum bvhd_status split_refs(const struct split_request *request, struct memory *memory, const struct parallel *parallel,
                            struct split_tree *ret_tree, struct bvhd_error *error);

#endif
