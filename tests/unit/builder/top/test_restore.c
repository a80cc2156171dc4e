/* SPDX-License-Identifier: Apache-2.0 */
/* test_restore.c - tests that trees get the exact boxes of their primitives, of what moves those at both ends. */
#include "tests/support/unit.h"

#include "builder/input/primitive.h"
#include "builder/top/restore.h"
#include "tests/support/builder/test_ir.h"

/* A tree with wrong boxes gets the boxes of its primitives, bit for bit as a tree made over them has. */
static void boxes_come_back(void **state)
{
    (void)state;
    struct test_shape shape = {
        .type = GEOMETRY_TRIANGLES, .geometries = 3, .primitives = 4000, .size = 1e30, .detail = 0.01};
    struct test_model model;
    struct memory memory;
    struct ir ir;
    double cost;
    memory_init(&memory, UINT64_MAX);
    test_model_make(&shape, 4, &model);
    for (uint32_t id = 0; id < 12000; id++)
        model.boxes[id] = primitive_box(&model.canonical, &model.canonical.geometries[id / 4000], id % 4000);
    assert_int_equal(test_ir_make(model.boxes, 12000, 3, &memory, &ir), BVHD_OK);
    size_t size = ir.node_count * sizeof *ir.boxes[0];
    struct box *before = malloc(size);
    assert_non_null(before);
    memcpy(before, ir.boxes[0], size);
    memset(ir.boxes[0], 0, size);
    assert_int_equal(restore_boxes(&model.canonical, NULL, &ir, &cost), BVHD_OK);
    assert_memory_equal(ir.boxes[0], before, size);
    assert_true(cost == ir_cost(&ir, 0, ir.node_count));
    free(before);
    ir_finish(&ir);
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

/* The boxes that primitive_key_boxes gives, as ir_check wants them. */
static struct box *keys_of(const struct canonical *canonical)
{
    const uint32_t count = canonical->primitive_count;
    struct box *boxes = calloc(2 * (size_t)count, sizeof *boxes);
    assert_non_null(boxes);
    for (uint32_t id = 0; id < count; id++) {
        const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, id)];
        struct box own[2], both = primitive_box(canonical, geometry, id - geometry->first_primitive), sum;
        primitive_key_boxes(canonical, geometry, id - geometry->first_primitive, own);
        sum = own[0];
        box_grow(&sum, &own[1]);
        assert_memory_equal(&sum, &both, sizeof both);
        boxes[id] = own[0];
        boxes[count + id] = own[1];
    }
    return boxes;
}

static const struct test_shape moving[] = {
    {.type = GEOMETRY_MOVING_TRIANGLES, .geometries = 3, .primitives = 4000, .size = 10, .detail = 0.01},
    {.type = GEOMETRY_MOVING_INSTANCES, .geometries = 1, .primitives = 3000, .size = 10, .detail = 0.01},
};

static void make_moving(const struct test_shape *shape, struct test_model *ret_model)
{
    test_model_make(shape, 5, ret_model);
    for (uint32_t i = 0; i < ret_model->canonical.reference_count; i++)
        ret_model->canonical.references[i].bounds = (struct box){{0, 0, 0}, {1, 1, 1}};
}

/* Each leaf has the exact boxes at both ends of its primitives, and each inner node those of its children. */
static void what_moves_gets_two_keys(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (size_t s = 0; s < sizeof moving / sizeof *moving; s++) {
        struct test_model model;
        struct ir ir;
        double cost;
        make_moving(&moving[s], &model);
        const uint32_t count = model.canonical.primitive_count;
        struct box *keys = keys_of(&model.canonical);
        for (uint32_t id = 0; id < count; id++) {
            model.boxes[id] = keys[id];
            box_grow(&model.boxes[id], &keys[count + id]);
        }
        assert_int_equal(test_ir_make(model.boxes, count, 3, &memory, &ir), BVHD_OK);
        assert_int_equal(restore_boxes(&model.canonical, NULL, &ir, &cost), BVHD_OK);
        assert_int_equal(ir.key_count, 2);
        assert_float_equal(cost, ir_cost(&ir, 0, ir.node_count), 1e-9 * cost);
        assert_int_equal(ir_check(&ir, count, keys, false, &memory, NULL), BVHD_OK);
        for (uint32_t node = 0; node < ir.node_count; node++)
            for (uint32_t key = 0; key < 2; key++) {
                const struct ir_node *own = &ir.nodes[node];
                struct box exact = box_empty();
                for (uint32_t i = own->first; own->count && i < own->first + own->count; i++)
                    box_grow(&exact, &keys[key * count + ir.refs[i]]);
                for (uint32_t child = own->first; !own->count && child < own->first + 2; child++)
                    box_grow(&exact, &ir.boxes[key][child]);
                assert_memory_equal(&exact, &ir.boxes[key][node], sizeof exact);
            }
        ir_finish(&ir);
        free(keys);
        test_model_finish(&model);
    }
    assert_int_equal(memory.live, 0);
}

/* Without memory for the second key, and when cancelled, the tree can still be ended. */
static void failures_are_reported(void **state)
{
    (void)state;
    struct memory memory;
    struct test_model model;
    struct ir ir;
    atomic_bool cancel = true;
    double cost;
    memory_init(&memory, UINT64_MAX);
    make_moving(&moving[0], &model);
    assert_int_equal(test_ir_make(model.boxes, model.canonical.primitive_count, 3, &memory, &ir), BVHD_OK);
    memory.limit = memory.live;
    assert_int_equal(restore_boxes(&model.canonical, NULL, &ir, &cost), BVHD_NO_MEMORY);
    assert_int_equal(ir.key_count, 1);
    memory.limit = UINT64_MAX;
    assert_int_equal(restore_boxes(&model.canonical, &cancel, &ir, &cost), BVHD_CANCELLED);
    ir_finish(&ir);
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_come_back),
        cmocka_unit_test(what_moves_gets_two_keys),
        cmocka_unit_test(failures_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
