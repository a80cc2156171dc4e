/* SPDX-License-Identifier: Apache-2.0 */
/*
 * collapse.h - from the binary ir to an 8-wide tree of least SAH cost, by dynamic programming (Ylitie 2017, section 4).
 *
 * Subtrees of at most leaf_max refs may become leaves. Cost: an inner node counts its area and a little more
 * (collapse_cost.h), a leaf its area times refs times leaf_cost.
 */
#ifndef BVHD_COLLAPSE_H
#define BVHD_COLLAPSE_H

#include <stdatomic.h>

#include "builder/format/ir.h"
#include "proto/base/parallel.h"
#include "builder/format/wide.h"

struct collapse_options {
    uint32_t leaf_max; /* 1 .. 3; ir leaves may not be larger */
    float leaf_cost; /* of one ref against one wide node */
    const atomic_bool *cancel; /* may be NULL */
    /* children are given slots in half the time, where a few rays more meet them in the wrong order */
    bool quick_order;
};

/* The caller ends *ret_wide with wide_finish. The same for any number of threads. */
enum bvhd_status collapse(const struct ir *ir, const struct collapse_options *options, struct memory *memory,
                          const struct parallel *parallel, struct wide *ret_wide, struct bvhd_error *error);

#endif
