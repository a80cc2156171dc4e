/* SPDX-License-Identifier: Apache-2.0 */
/* test_blob.h - serialized structures over the generated models of test_ir.h. For test programs only. */
#ifndef BVHD_TEST_BLOB_H
#define BVHD_TEST_BLOB_H

#include "builder/format/lavapipe.h"
#include "builder/format/layout.h"
#include "proto/base/parallel.h"
#include "tests/support/builder/test_ir.h"

/*
 * Makes a tree over a model, by median splits or, where builders_asked() says so, by Embree; collapses it and writes
 * the portable layout; see layout->write.
 */
enum bvhd_status test_blob_write(const struct test_model *model, uint32_t layout_flags, struct memory *memory,
                                 const struct parallel *parallel, unsigned char **ret_blob,
                                 struct layout_sizes *ret_sizes, struct bvhd_error *error);

/* Does the same in one step from a shape, in a 64-byte aligned block of exactly the right size. */
struct bytes test_blob_make(const struct test_shape *shape, uint64_t seed, uint32_t layout_flags);

/*
 * Makes such a tree over a model and writes the lavapipe layout, for a driver whose UUIDs are "driver" and
 * "compatibility".
 */
enum bvhd_status test_blob_write_native(const struct test_model *model, enum lavapipe_variant variant,
                                        struct memory *memory, const struct parallel *parallel,
                                        unsigned char **ret_blob, struct layout_sizes *ret_sizes,
                                        struct bvhd_error *error);
struct bytes test_blob_make_native(const struct test_shape *shape, uint64_t seed, enum lavapipe_variant variant);

void test_blob_free(struct bytes blob);

/*
 * Shapes for tests of what a layout writes: a few and many primitives of each kind, in one geometry and in several,
 * with and without inactive ones, in a small, a large and a far model. Each has active primitives. The last one has
 * instances.
 */
enum { TEST_BLOB_SHAPES = 9 };
extern const struct test_shape test_blob_shapes[TEST_BLOB_SHAPES];

/* Fills freed memory of about `size` bytes with garbage, so that bytes that a writer leaves out are not zero. */
void test_blob_dirty_heap(uint64_t size);

#endif
