/* SPDX-License-Identifier: Apache-2.0 */
/* reference_builder.h - rtcBuildBVH as a user of Embree alone would call it: MEDIUM, two-wide, defaults, nodes from Embree's own allocator. */
#ifndef BVHD_REFERENCE_BUILDER_H
#define BVHD_REFERENCE_BUILDER_H

#include "primitive.h"

struct reference_result {
    double ms; /* of rtcBuildBVH alone */
    double sah; /* as ir_sah */
};

/*
 * Builds over a copy of the refs on `threads` threads. The device lives for this call alone: while it does, it decides on the number of threads
 * of every Embree device of the process. False, and a line on stderr, when Embree fails.
 */
bool reference_build(const struct primitive_ref *refs, uint32_t count, unsigned threads, struct reference_result *ret_result);

#endif
