/* SPDX-License-Identifier: Apache-2.0 */
/* test_blob.h - serialized portable structures over the generated models of test_ir.h. For test programs only. */
#ifndef BVHD_TEST_BLOB_H
#define BVHD_TEST_BLOB_H

#include "layout.h"
#include "parallel.h"
#include "test_ir.h"

/* Tree, collapse and layout over a model; as layout->write. */
enum bvhd_status test_blob_write(const struct test_model *model, uint32_t layout_flags, struct memory *memory,
                                 const struct parallel *parallel, unsigned char **ret_blob, struct layout_sizes *ret_sizes,
                                 struct bvhd_error *error);

/* The same in one step from a shape, in a 64-byte aligned block of exactly the right size. */
struct bytes test_blob_make(const struct test_shape *shape, uint64_t seed, uint32_t layout_flags);
void test_blob_free(struct bytes blob);

#endif
