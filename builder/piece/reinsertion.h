/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reinsertion.h - a tree made better after it was built: subtrees are taken out and put back where they cost least
 * (Bittner 2013; the search is that of Meister and Bittner 2018), on one thread, one after the other.
 *
 * A pass tries all nodes or the largest, in which most of the cost lies, in the order of the nodes: by size first is no
 * better. At the end leaves are made as large as pays by SAH, in which a primitive that was split is named once.
 */
#ifndef BVHD_REINSERTION_H
#define BVHD_REINSERTION_H

#include <stdatomic.h>

#include "builder/format/ir.h"

enum { REINSERTION_LEAF_MOST = 3 };

struct reinsertion_request {
    /*
     * Of one key; not empty; each leaf holds one ref; the first of each pair of children has an odd number; a node's
     * box is that of its children, no larger. Ended as soon as it is read.
     */
    struct ir *ir;
    uint32_t leaf_max; /* 1 .. REINSERTION_LEAF_MOST */
    uint32_t passes;
    float share; /* of all nodes, the largest, that a pass tries, about */
    float last_share; /* likewise, the last pass */
    const atomic_bool *cancel; /* may be NULL; looked at every few hundred searches */
};

/*
 * request->ir and *ret_ir are of `memory`, by ir_init. No leaf, and no subtree of at most leaf_max refs, names an id
 * twice. Boxes' magnitudes are at most 2^40. The time is bounded, whatever the tree. BVHD_NO_MEMORY, BVHD_CANCELLED.
 */
enum bvhd_status reinsertion_run(const struct reinsertion_request *request, struct memory *memory, struct ir *ret_ir,
                                 struct bvhd_error *error);

#endif
