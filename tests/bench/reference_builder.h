/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_builder.h - what our builds are measured against: rtcBuildBVH as a user of Embree alone would call it, with
 * nodes from Embree's own allocator, and the SAH of a tree by full sweeps.
 */
#ifndef BVHD_REFERENCE_BUILDER_H
#define BVHD_REFERENCE_BUILDER_H

#include "builder/input/primitive.h"

enum reference_method {
    REFERENCE_MEDIUM, /* two-wide, defaults */
    REFERENCE_LOW_WIDE, /* LOW, eight-wide */
    REFERENCE_METHODS
};

struct reference_result {
    double ms; /* of rtcBuildBVH alone */
    double cpu_ms; /* processor time of the whole process meanwhile */
    double sah; /* as ir_sah; of REFERENCE_MEDIUM alone */
};

/*
 * Builds over a copy of the refs on `threads` threads. The device lives for this call alone: while it does, it decides
 * on the number of threads of every Embree device of the process. False, and a line on stderr, when Embree fails.
 */
bool reference_build(enum reference_method kind, const struct primitive_ref *refs, uint32_t count, unsigned threads,
                     struct reference_result *ret_result);

/*
 * As ir_sah, of the tree in which each node is divided at the best of all places along the three axes, and is a leaf
 * where that is no dearer. Takes seconds for a million. 0 without area or memory.
 */
double reference_sweep_sah(const struct primitive_ref *refs, uint32_t count);

#endif
