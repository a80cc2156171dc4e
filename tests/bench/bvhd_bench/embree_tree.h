/* SPDX-License-Identifier: Apache-2.0 */
/*
 * embree_tree.h - calls rtcBuildBVH as a user of Embree alone would: with defaults, and nodes from Embree's allocator.
 */
#ifndef BVHD_BENCH_EMBREE_TREE_H
#define BVHD_BENCH_EMBREE_TREE_H

#include "tests/bench/bvhd_bench/method.h"
#include "builder/input/primitive.h"
#include "tests/bench/bvhd_bench/tree.h"

struct embree_tree_request {
    const struct method *method; /* METHOD_BVH */
    const struct ply *mesh;
    const struct primitive_refs *refs; /* of the triangles of the mesh */
    unsigned threads;
    bool want_tree;
};

struct embree_tree_result {
    double ms, cpu_ms; /* time of rtcBuildBVH alone, and processor time of the whole process during it */
    uint64_t bytes; /* what the device holds after the build */
    struct tree tree; /* empty unless want_tree */
};

/*
 * Builds over a copy of the refs. The device lives only during this call; while it lives, its number of threads applies
 * to every Embree device of the process. Returns NULL, or what went wrong.
 */
const char *embree_tree_build(const struct embree_tree_request *request, struct embree_tree_result *ret_result);

#endif
