/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_ir.h - small structures for tests of the code after the builders: a canonical view over generated primitives,
 * and a tree over them by median splits, which needs no builder.
 *
 * For test programs only: if malloc fails they print a message and end; allocations through a struct memory fail
 * normally.
 */
#ifndef BVHD_TEST_IR_H
#define BVHD_TEST_IR_H

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "tests/support/random.h"

struct test_model {
    struct canonical canonical;
    struct box *boxes; /* of each primitive, over both keys; empty: it is not in the tree */
    struct box *keys[IR_MAX_KEYS]; /* its box at t = 0 and at t = 1; NULL unless it moves */
    void *data[3]; /* the arrays that the view points to */
};

struct test_shape {
    uint32_t type; /* GEOMETRY_ */
    uint32_t geometries; /* 1 for instances */
    uint32_t primitives; /* in each geometry */
    double centre; /* on every axis */
    double size; /* of the whole model */
    double detail; /* size of a primitive, as a share of the whole */
    uint32_t inactive; /* every n-th primitive is not in the tree; 0: none */
    bool soup; /* triangles and spheres: without indices */
};

/*
 * Makes a model. Every other geometry is opaque. The triangles of a geometry share vertices, a third as many as there
 * are triangles and some more, not all of which are used. So do spheres, and linear swept spheres, which are in chains
 * of up to seven, with any caps. Every third geometry of motion triangles stands still. Motion instances are of each
 * type in turn.
 */
void test_model_make(const struct test_shape *shape, uint64_t seed, struct test_model *ret_model);
void test_model_finish(struct test_model *model);

/*
 * Makes a tree by median splits along the longest axis over the primitives whose boxes are not empty; leaves have 1 to
 * leaf_max refs.
 */
enum bvhd_status test_ir_make(const struct box *boxes, uint32_t count, uint32_t leaf_max, struct memory *memory,
                              struct ir *ret_ir);

#endif
