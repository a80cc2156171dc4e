/* SPDX-License-Identifier: Apache-2.0 */
/*
 * collapse.h - turns a binary tree (ir) into the 8-wide tree of least SAH cost, by dynamic programming (Ylitie 2017,
 * section 4).
 *
 * Subtrees of at most leaf_max refs may become leaves. An inner node costs its area and a little more
 * (collapse_cost.h), a leaf its area times its refs times leaf_cost.
 */
#ifndef BVHD_COLLAPSE_H
#define BVHD_COLLAPSE_H

#include <stdatomic.h>

#include "builder/format/ir.h"
#include "proto/base/parallel.h"
#include "builder/format/wide.h"

struct collapse_options {
    uint32_t leaf_max; /* most refs of a leaf, 1 .. 3; leaves of the ir may not be larger */
    float leaf_cost; /* cost of testing one ref, relative to one wide node */
    const atomic_bool *cancel; /* may be NULL */
    /* assign children to slots in half the time; a few more rays then visit them in the wrong order */
    bool quick_order;
};

/*
 * Collapses the tree. The caller ends *ret_wide with wide_finish. The result is the same for any number of threads.
 * Returns BVHD_NO_MEMORY, BVHD_CANCELLED, or BVHD_INTERNAL with the place when a leaf of the ir has more than leaf_max
 * refs.
 */
enum bvhd_status collapse(const struct ir *ir, const struct collapse_options *options, struct memory *memory,
                          const struct parallel *parallel, struct wide *ret_wide, struct bvhd_error *error);

#endif
