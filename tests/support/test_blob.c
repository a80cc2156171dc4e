/* SPDX-License-Identifier: Apache-2.0 */
#include "test_blob.h"

#include <stdio.h>
#include <stdlib.h>

#include "collapse.h"

enum bvhd_status test_blob_write(const struct test_model *model, uint32_t layout_flags, struct memory *memory,
                                 const struct parallel *parallel, unsigned char **ret_blob, struct layout_sizes *ret_sizes,
                                 struct bvhd_error *error)
{
    const struct collapse_options options = {.leaf_max = layout_portable.leaf_max, .leaf_cost = 0.3f};
    struct ir ir;
    struct wide wide = {0};
    enum bvhd_status status = test_ir_make(model->boxes, model->canonical.primitive_count, layout_portable.leaf_max, memory, &ir);
    if (status != BVHD_OK)
        return bvhd_error_set(error, status, "ir", "test tree");
    status = collapse(&ir, &options, memory, parallel, &wide, error);
    if (status == BVHD_OK) {
        const struct layout_input input = {.canonical = &model->canonical,
                                           .ir = &ir,
                                           .wide = &wide,
                                           .layout_flags = layout_flags,
                                           .memory = memory,
                                           .parallel = parallel};
        status = layout_portable.write(&input, ret_blob, ret_sizes, error);
        wide_finish(&wide);
    }
    ir_finish(&ir);
    return status;
}

struct bytes test_blob_make(const struct test_shape *shape, uint64_t seed, uint32_t layout_flags)
{
    struct memory memory;
    struct test_model model;
    struct layout_sizes sizes;
    unsigned char *blob;
    void *copy = NULL;
    memory_init(&memory, UINT64_MAX);
    test_model_make(shape, seed, &model);
    if (test_blob_write(&model, layout_flags, &memory, &parallel_serial, &blob, &sizes, NULL) != BVHD_OK ||
        posix_memalign(&copy, 64, sizes.total) != 0) {
        fprintf(stderr, "no memory for a test\n");
        abort();
    }
    memcpy(copy, blob, sizes.total);
    memory_free(&memory, blob);
    test_model_finish(&model);
    return (struct bytes){copy, sizes.total};
}

void test_blob_free(struct bytes blob)
{
    union {
        const void *in;
        void *out;
    } block = {blob.data};
    free(block.out);
}
