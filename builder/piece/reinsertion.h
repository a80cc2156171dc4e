/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reinsertion.h - improves a finished tree: takes subtrees out and puts them back where they cost least (Bittner 2013,
 * with the search of Meister and Bittner 2018), one after the other, on one thread.
 *
 * A pass tries all nodes or the largest ones, which hold most of the cost, in the order of the nodes; trying the
 * largest first gives no better trees. At the end leaves become as large as SAH justifies, and a primitive that was
 * split occurs in a leaf only once.
 */
#ifndef BVHD_REINSERTION_H
#define BVHD_REINSERTION_H

#include <stdatomic.h>

#include "builder/format/ir.h"

enum { REINSERTION_LEAF_MOST = 3 };

struct reinsertion_request {
    /*
     * The tree to improve, which has nodes and one motion key. Each leaf holds one ref, the first child of each pair
     * has an odd number, and a node's box is exactly that of its children. Its arrays are freed as soon as they have
     * been read; after a failure the caller has to call ir_finish for it.
     */
    struct ir *ir;
    uint32_t leaf_max; /* 1 .. REINSERTION_LEAF_MOST */
    uint32_t passes;
    float share; /* share of all nodes, taken from the largest, that each pass but the last tries; approximate */
    float last_share; /* the same for the last pass */
    const atomic_bool *cancel; /* may be NULL; checked every few hundred searches */
};

/*
 * Improves request->ir and returns a new tree, both allocated from `memory` with ir_init. In the result no leaf, and no
 * subtree of at most leaf_max refs, names a primitive twice. Magnitudes are at most 2^40. The time is bounded for any
 * tree. Returns BVHD_NO_MEMORY or BVHD_CANCELLED.
 */
enum bvhd_status reinsertion_run(const struct reinsertion_request *request, struct memory *memory, struct ir *ret_ir,
                                 struct bvhd_error *error);

#endif
