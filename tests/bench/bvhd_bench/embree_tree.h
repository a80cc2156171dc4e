/* SPDX-License-Identifier: Apache-2.0 */
/* embree_tree.h - rtcBuildBVH as a user of Embree alone would call it: defaults, nodes from Embree's own allocator. */
#ifndef BVHD_BENCH_EMBREE_TREE_H
#define BVHD_BENCH_EMBREE_TREE_H

#include "tests/bench/bvhd_bench/method.h"
#include "builder/input/primitive.h"
#include "tests/bench/bvhd_bench/tree.h"

struct embree_tree_result {
    double ms; /* of rtcBuildBVH alone */
    uint64_t bytes; /* what its device holds afterwards */
    struct tree tree; /* empty unless asked for */
};

/*
 * Builds over a copy of the refs of triangles of `mesh`. The device lives for this call alone: while it does, it
 * decides on the number of threads of every Embree device of the process. NULL, or what went wrong.
 */
const char *embree_tree_build(const struct method *method, const struct ply *mesh, const struct primitive_refs *refs,
                              unsigned threads, bool want_tree, struct embree_tree_result *ret_result);

#endif
