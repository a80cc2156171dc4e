/* SPDX-License-Identifier: Apache-2.0 */
/*
 * summary.h - what is known about a structure beside its bytes and its key. The builder makes the summary
 * (builder/summary.h); caches keep it, results carry it on the wire (proto/wire/control.h), and programs read it from
 * their results (client/result_summary.h).
 */
#ifndef BVHD_BASE_SUMMARY_H
#define BVHD_BASE_SUMMARY_H

#include <stdint.h>

#include "proto/base/box.h"
#include "proto/base/slabs.h"

enum { SUMMARY_METHOD_SIZE = 64 };

/* Fields that are not explained here are those of build_stats (builder/build.h). There is no padding. */
struct summary {
    uint64_t primitives, triangles, instances, inactive, degenerate, skipped, refs;
    uint64_t peak_bytes; /* the most memory that the build took at a time */
    uint32_t depth;
    uint32_t target; /* TARGET_: the layout of the bytes; another daemon may know more of them */
    uint32_t quality; /* QUALITY_: the quality that was built */
    uint32_t refits; /* updates since the last build, this one included; 0: a build */
    double sah;
    double decay; /* of an update: the cost of tracing it over that of the last build; 0: a build */
    double build_ms; /* the duration of the build that made the bytes */
    char method[SUMMARY_METHOD_SIZE];
    struct box bounds;
    struct slabs slabs;
};

#endif
