/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/test_blob.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/wide/collapse.h"

enum bvhd_status test_blob_write(const struct test_model *model, uint32_t layout_flags, struct memory *memory,
                                 const struct parallel *parallel, unsigned char **ret_blob,
                                 struct layout_sizes *ret_sizes, struct bvhd_error *error)
{
    const struct collapse_options options = {.leaf_max = layout_portable.leaf_max, .leaf_cost = 0.3f};
    struct ir ir;
    struct wide wide = {0};
    enum bvhd_status status =
        test_ir_make(model->boxes, model->canonical.primitive_count, layout_portable.leaf_max, memory, &ir);
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

static struct bytes copy_blob(const unsigned char *blob, uint64_t size)
{
    void *copy = NULL;
    if (posix_memalign(&copy, 64, size) != 0) {
        fprintf(stderr, "no memory for a test\n");
        abort();
    }
    memcpy(copy, blob, size);
    return (struct bytes){copy, size};
}

static void need(enum bvhd_status status)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "no memory for a test\n");
    abort();
}

struct bytes test_blob_make(const struct test_shape *shape, uint64_t seed, uint32_t layout_flags)
{
    struct memory memory;
    struct test_model model;
    struct layout_sizes sizes;
    unsigned char *blob;
    memory_init(&memory, UINT64_MAX);
    test_model_make(shape, seed, &model);
    need(test_blob_write(&model, layout_flags, &memory, &parallel_serial, &blob, &sizes, NULL));
    struct bytes copy = copy_blob(blob, sizes.total);
    memory_free(&memory, blob);
    test_model_finish(&model);
    return copy;
}

enum bvhd_status test_blob_write_native(const struct test_model *model, enum lavapipe_variant variant,
                                        struct memory *memory, const struct parallel *parallel,
                                        unsigned char **ret_blob, struct layout_sizes *ret_sizes,
                                        struct bvhd_error *error)
{
    const struct device_format device = {
        .driver_uuid = "driver", .compatibility_uuid = "compatibility", .variant = variant};
    struct ir ir;
    enum bvhd_status status = test_ir_make(model->boxes, model->canonical.primitive_count, 1, memory, &ir);
    if (status != BVHD_OK)
        return bvhd_error_set(error, status, "ir", "test tree");
    const struct layout_input input = {
        .canonical = &model->canonical, .ir = &ir, .device = &device, .memory = memory, .parallel = parallel};
    status = layout_lavapipe.write(&input, ret_blob, ret_sizes, error);
    ir_finish(&ir);
    return status;
}

struct bytes test_blob_make_native(const struct test_shape *shape, uint64_t seed, enum lavapipe_variant variant)
{
    struct memory memory;
    struct test_model model;
    struct layout_sizes sizes;
    unsigned char *blob;
    memory_init(&memory, UINT64_MAX);
    test_model_make(shape, seed, &model);
    need(test_blob_write_native(&model, variant, &memory, &parallel_serial, &blob, &sizes, NULL));
    struct bytes copy = copy_blob(blob, sizes.total);
    memory_free(&memory, blob);
    test_model_finish(&model);
    return copy;
}

void test_blob_free(struct bytes blob)
{
    union {
        const void *in;
        void *out;
    } block = {blob.data};
    free(block.out);
}

const struct test_shape test_blob_shapes[TEST_BLOB_SHAPES] = {
    {.type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 1, .size = 1, .detail = 0.5},
    {.type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 2, .size = 1, .detail = 0.5},
    {.type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 700, .size = 10, .detail = 0.05},
    {.type = GEOMETRY_TRIANGLES,
     .geometries = 7,
     .primitives = 230,
     .size = 1e-3,
     .detail = 0.05,
     .centre = 100,
     .inactive = 5},
    {.type = GEOMETRY_TRIANGLES,
     .geometries = 2,
     .primitives = 100,
     .size = 1e30,
     .detail = 0.05,
     .soup = true,
     .inactive = 9},
    {.type = GEOMETRY_AABBS, .geometries = 1, .primitives = 1, .size = 10, .detail = 0.02},
    {.type = GEOMETRY_AABBS, .geometries = 3, .primitives = 400, .size = 10, .detail = 0.02, .inactive = 4},
    {.type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 1, .size = 1000, .detail = 0.02},
    {.type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 300, .size = 1000, .detail = 0.02, .inactive = 7},
};

void test_blob_dirty_heap(uint64_t size)
{
    void *blocks[8];
    for (size_t i = 0; i < 8; i++) {
        blocks[i] = malloc(size + 64 * i);
        if (blocks[i])
            memset(blocks[i], 0xa5, size);
    }
    for (size_t i = 0; i < 8; i++)
        free(blocks[i]);
}
