/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_ir.h - small structures for tests of what comes after the builders: a canonical view over generated primitives,
 * and a tree over them by median splits, which needs no builder.
 *
 * For test programs only: without memory they say so and end, but for allocations through a struct memory.
 */
#ifndef BVHD_TEST_IR_H
#define BVHD_TEST_IR_H

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "tests/support/random.h"

struct test_model {
    struct canonical canonical;
    struct box *boxes; /* of each primitive; empty: not in the tree */
    void *data[3]; /* what the view points to */
};

struct test_shape {
    uint32_t type; /* GEOMETRY_ */
    uint32_t geometries; /* 1 for instances */
    uint32_t primitives; /* of each geometry */
    double centre; /* on every axis */
    double size; /* of the whole */
    double detail; /* of a primitive, as a share of the whole */
    uint32_t inactive; /* every n-th primitive is not in the tree; 0: none */
    bool soup; /* triangles: without indices */
};

/*
 * Every other geometry is opaque. Triangles of a geometry share a random third as many vertices, not all of which are
 * used.
 */
void test_model_make(const struct test_shape *shape, uint64_t seed, struct test_model *ret_model);
void test_model_finish(struct test_model *model);

/* Median splits along the longest axis over the primitives whose boxes are not empty; leaves of 1 to leaf_max refs. */
enum bvhd_status test_ir_make(const struct box *boxes, uint32_t count, uint32_t leaf_max, struct memory *memory,
                              struct ir *ret_ir);

#endif
