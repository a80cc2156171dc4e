/* SPDX-License-Identifier: Apache-2.0 */
/*
 * split.h - our own binned SAH splitting (Wald 2007), which cuts a set of refs into pieces.
 *
 * Used above Embree, to make pieces of bounded size so that a build can be cancelled, shared out and take turns; and as a whole builder
 * where a piece comes back from elsewhere too coarse or not at all (piece size = leaf size). Where nothing separates the refs they are halved
 * in their order, so the depth stays within log2 of the count there.
 */
#ifndef BVHD_SPLIT_H
#define BVHD_SPLIT_H

#include <stdatomic.h>

#include "memory.h"
#include "parallel.h"
#include "primitive.h"

/* A node of the cut: inner nodes have two children at `child` and `child + 1`, pieces have child 0 and refs[first .. first + count). */
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

/*
 * Permutes `refs` so that each piece is contiguous and no piece has more than `piece_size` refs. `scratch` has room for as many refs. The
 * caller frees ret_tree->nodes. The result does not depend on the number of threads. `cancel` may be NULL; checked at every node.
 */
enum bvhd_status split_refs(struct primitive_ref *refs, struct primitive_ref *scratch, uint32_t count, uint32_t piece_size,
                            const atomic_bool *cancel, struct memory *memory, const struct parallel *parallel,
                            struct split_tree *ret_tree, struct bvhd_error *error);

#endif
