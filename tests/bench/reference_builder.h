/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_builder.h - the reference for our builds: rtcBuildBVH, called as a user of Embree alone would call it, with
 * nodes from Embree's own allocator, and the SAH cost of a tree by full sweeps.
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
    double ms; /* time of rtcBuildBVH alone */
    double cpu_ms; /* processor time of the whole process during the build */
    double sah; /* computed like ir_sah; only for REFERENCE_MEDIUM */
};

/*
 * Builds over a copy of the refs on `threads` threads. The device lives only during this call; while it lives, its
 * number of threads applies to every Embree device of the process. Returns false, with a line on stderr, when Embree
 * fails.
 */
bool reference_build(enum reference_method kind, const struct primitive_ref *refs, uint32_t count, unsigned threads,
                     struct reference_result *ret_result);

/*
 * The cost, by the formula of ir_sah, of the tree in which each node is split at the best of all positions along the
 * three axes, and is a leaf where that costs no more. Takes seconds for a million refs. Returns 0 when the refs have no
 * area or there is no memory.
 */
double reference_sweep_sah(const struct primitive_ref *refs, uint32_t count);

#endif
