/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/test_blob.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/piece/embree.h"
#include "builder/rescale.h"
#include "builder/wide/collapse.h"
#include "tests/support/builder/builders.h"

/* Lists the primitives that are in the tree. Returns their number. */
static uint32_t collect(const struct test_model *model, struct primitive_ref *ret_refs, struct box *ret_bounds)
{
    uint32_t count = 0;
    *ret_bounds = box_empty();
    for (uint32_t i = 0; i < model->canonical.primitive_count; i++) {
        const struct box *box = &model->boxes[i];
        if (box_is_empty(box))
            continue;
        box_grow(ret_bounds, box);
        ret_refs[count] = (struct primitive_ref){.id = i};
        memcpy(ret_refs[count].min, box->min, sizeof box->min);
        memcpy(ret_refs[count++].max, box->max, sizeof box->max);
    }
    return count;
}

static enum bvhd_status make_median_tree(const struct test_model *model, uint32_t leaf_max, struct memory *memory,
                                         struct ir *ret_ir, struct bvhd_error *error)
{
    enum bvhd_status status = test_ir_make(model->boxes, model->canonical.primitive_count, leaf_max, memory, ret_ir);
    return status == BVHD_OK ? BVHD_OK : bvhd_error_set(error, status, "ir", "test tree");
}

/* Embree gets no empty models, no large ones, and none that would be scaled before. */
static enum bvhd_status make_embree_tree(const struct test_model *model, uint32_t leaf_max, struct memory *memory,
                                         struct ir *ret_ir, struct bvhd_error *error)
{
    static struct primitive_ref refs[EMBREE_PIECE_MOST];
    struct box bounds;
    const uint32_t count = model->canonical.primitive_count <= EMBREE_PIECE_MOST ? collect(model, refs, &bounds) : 0;
    if (count == 0 || rescale_is_needed(&bounds))
        return make_median_tree(model, leaf_max, memory, ret_ir, error);
    struct primitive_ref *scratch = memory_array(memory, count, sizeof *scratch);
    enum bvhd_status status = scratch ? embree_open(error) : bvhd_error_no_memory(error, "ir", "test tree");
    if (status == BVHD_OK) {
        const struct embree_request request = {.quality = EMBREE_MEDIUM,
                                               .canonical = &model->canonical,
                                               .refs = refs,
                                               .scratch = scratch,
                                               .count = count,
                                               .capacity = count,
                                               .leaf_max = leaf_max};
        status = embree_build(&request, memory, ret_ir, error);
        embree_close();
    }
    memory_free(memory, scratch);
    return status;
}

/* Makes a tree by median splits, which needs no builder, or by Embree where the environment names it. */
static enum bvhd_status make_tree(const struct test_model *model, uint32_t leaf_max, struct memory *memory,
                                  struct ir *ret_ir, struct bvhd_error *error)
{
    return builders_asked() == BUILDER_EMBREE ? make_embree_tree(model, leaf_max, memory, ret_ir, error)
                                              : make_median_tree(model, leaf_max, memory, ret_ir, error);
}

/* Gives each node the boxes at t = 0 and at t = 1 of a tree that was made over the boxes of both. */
static enum bvhd_status add_keys(const struct test_model *model, struct ir *ir, struct bvhd_error *error)
{
    if (!model->keys[0] || ir->node_count == 0)
        return BVHD_OK;
    ir->boxes[1] = memory_array(ir->memory, ir->node_count, sizeof *ir->boxes[1]);
    if (!ir->boxes[1])
        return bvhd_error_no_memory(error, "ir", "test tree");
    ir->key_count = IR_MAX_KEYS;
    for (uint32_t key = 0; key < IR_MAX_KEYS; key++)
        for (uint32_t i = ir->node_count; i-- > 0;) {
            const struct ir_node *node = &ir->nodes[i];
            struct box box = box_empty();
            for (uint32_t k = 0; k < node->count; k++)
                box_grow(&box, &model->keys[key][ir->refs[node->first + k]]);
            for (uint32_t k = 0; k < 2 && node->count == 0; k++)
                box_grow(&box, &ir->boxes[key][node->first + k]);
            ir->boxes[key][i] = box;
        }
    return BVHD_OK;
}

enum bvhd_status test_blob_write(const struct test_model *model, uint32_t layout_flags, struct memory *memory,
                                 const struct parallel *parallel, unsigned char **ret_blob,
                                 struct layout_sizes *ret_sizes, struct bvhd_error *error)
{
    const struct collapse_options options = {.leaf_max = layout_portable.leaf_max, .leaf_cost = 0.3f};
    struct ir ir;
    struct wide wide = {0};
    enum bvhd_status status = make_tree(model, layout_portable.leaf_max, memory, &ir, error);
    if (status != BVHD_OK)
        return status;
    status = collapse(&ir, &options, memory, parallel, &wide, error);
    if (status == BVHD_OK) {
        const struct layout_input input = {.canonical = &model->canonical,
                                           .ir = &ir,
                                           .wide = &wide,
                                           .layout_flags = layout_flags,
                                           .memory = memory,
                                           .parallel = parallel};
        status = add_keys(model, &ir, error);
        if (status == BVHD_OK)
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
    enum bvhd_status status = make_tree(model, 1, memory, &ir, error);
    if (status != BVHD_OK)
        return status;
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
