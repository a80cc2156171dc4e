/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_lavapipe_bounds.c - tests that boxes of split references and of instances grow as the lavapipe driver needs it.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/build.h"
#include "builder/format/lavapipe.h"
#include "builder/format/lavapipe_bounds.h"
#include "tests/support/builder/test_ir.h"

static const struct build_options native = {
    .quality = QUALITY_HIGH, .target = TARGET_LAVAPIPE, .device = {.variant = LAVAPIPE_PLAIN}};

/* The same tree twice, with the builder's boxes and with the layout's boxes. */
struct pair {
    struct memory memory;
    struct ir before, after;
};

static void build_ir_for(enum target target, const struct canonical *canonical, struct memory *memory,
                         struct ir *ret_ir)
{
    struct build_options options = native;
    struct build_context context = {.memory = memory, .parallel = &parallel_serial};
    struct build_stats stats;
    options.target = target;
    assert_int_equal(build_ir(canonical, &options, &context, ret_ir, &stats, NULL), BVHD_OK);
    assert_true(fabs(stats.sah - ir_sah(ret_ir)) <= 1e-9 * stats.sah);
}

static void duplicate(const struct ir *ir, struct memory *memory, struct ir *ret_ir)
{
    assert_int_equal(ir_init(ret_ir, memory, ir->node_count, ir->ref_count, NULL), BVHD_OK);
    memcpy(ret_ir->nodes, ir->nodes, ir->node_count * sizeof *ir->nodes);
    memcpy(ret_ir->boxes[0], ir->boxes[0], ir->node_count * sizeof *ir->boxes[0]);
    memcpy(ret_ir->refs, ir->refs, ir->ref_count * sizeof *ir->refs);
    ret_ir->node_count = ir->node_count;
    ret_ir->ref_count = ir->ref_count;
}

/* The triangles are long, so that the builder splits them. */
static void make_split_model(struct test_model *model)
{
    static const struct test_shape shape = {
        .type = GEOMETRY_TRIANGLES, .geometries = 2, .primitives = 1500, .size = 10, .detail = 0.2};
    test_model_make(&shape, 3, model);
}

/* Makes a tree with split references, before inflate_boxes, by halving the leaves of a tree of whole primitives. */
static void halve_leaves(struct ir *ir)
{
    for (uint32_t i = 0; i < ir->node_count; i++)
        if (ir_is_leaf(ir, i)) {
            struct box *box = &ir->boxes[0][i];
            box->max[i % 3] = box->min[i % 3] + (box->max[i % 3] - box->min[i % 3]) / 2;
        }
}

static void parts_grow_within_their_triangles(void **state)
{
    (void)state;
    struct pair pair;
    struct test_model model;
    memory_init(&pair.memory, UINT64_MAX);
    make_split_model(&model);
    assert_int_equal(test_ir_make(model.boxes, model.canonical.primitive_count, 1, &pair.memory, &pair.before),
                     BVHD_OK);
    float side = 0, slack;
    for (int axis = 0; axis < 3; axis++)
        side = fmaxf(side, pair.before.boxes[0][0].max[axis] - pair.before.boxes[0][0].min[axis]);
    slack = side / 65536;
    halve_leaves(&pair.before);
    duplicate(&pair.before, &pair.memory, &pair.after);
    assert_true(lavapipe_bounds_inflate(&model.canonical, &parallel_serial, NULL, &pair.after));
    for (uint32_t i = 0; i < pair.after.node_count; i++) {
        const struct box *before = &pair.before.boxes[0][i], *after = &pair.after.boxes[0][i];
        if (!ir_is_leaf(&pair.after, i)) {
            struct box children = pair.after.boxes[0][pair.after.nodes[i].first];
            box_grow(&children, &pair.after.boxes[0][pair.after.nodes[i].first + 1]);
            assert_memory_equal(&children, after, sizeof children);
            continue;
        }
        const struct box *whole = &model.boxes[pair.after.refs[pair.after.nodes[i].first]];
        assert_true(box_contains(after, before) && box_contains(whole, after));
        for (int axis = 0; axis < 3; axis++) {
            assert_true(after->max[axis] == fminf(whole->max[axis], before->max[axis] + slack));
            assert_true(after->min[axis] == whole->min[axis]);
        }
    }
    ir_finish(&pair.before);
    ir_finish(&pair.after);
    test_model_finish(&model);
    assert_int_equal(pair.memory.live, 0);
}

/* In the tree that a build passes to the layout, every box of a part has the margin, or is the whole triangle's box. */
static void builds_inflate_split_references(void **state)
{
    (void)state;
    struct pair pair;
    struct test_model model;
    memory_init(&pair.memory, UINT64_MAX);
    make_split_model(&model);
    build_ir_for(TARGET_LAVAPIPE, &model.canonical, &pair.memory, &pair.after);
    assert_true(pair.after.ref_count > model.canonical.primitive_count);
    assert_int_equal(ir_check(&pair.after, model.canonical.primitive_count, model.boxes, true, &pair.memory, NULL),
                     BVHD_OK);
    duplicate(&pair.after, &pair.memory, &pair.before);
    assert_true(lavapipe_bounds_inflate(&model.canonical, &parallel_serial, NULL, &pair.after));
    uint32_t grown = 0, whole = 0;
    for (uint32_t i = 0; i < pair.after.node_count; i++)
        if (ir_is_leaf(&pair.after, i)) {
            const struct box *triangle = &model.boxes[pair.after.refs[pair.after.nodes[i].first]];
            grown += memcmp(&pair.before.boxes[0][i], &pair.after.boxes[0][i], sizeof(struct box)) != 0;
            whole += memcmp(triangle, &pair.after.boxes[0][i], sizeof(struct box)) == 0;
        }
    assert_true(grown > 100 && whole > 100); /* parts grow a second time, whole triangles have not grown at all */
    ir_finish(&pair.before);
    ir_finish(&pair.after);
    test_model_finish(&model);
    assert_int_equal(pair.memory.live, 0);
}

/* Computes an instance's box in float, in the driver's order of operations. */
static struct box drivers_box(const float m[12], const struct box *bounds)
{
    struct box box;
    for (int row = 0; row < 3; row++) {
        float low = m[4 * row + 3], high = low;
        for (int k = 0; k < 3; k++) {
            float a = m[4 * row + k] * bounds->min[k], b = m[4 * row + k] * bounds->max[k];
            low += fminf(a, b);
            high += fmaxf(a, b);
        }
        box.min[row] = low;
        box.max[row] = high;
    }
    return box;
}

static void instances_contain_what_the_driver_computes(void **state)
{
    (void)state;
    static const struct test_shape shape = {
        .type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 2000, .size = 1000, .detail = 0.1};
    struct test_model model;
    struct memory memory;
    struct ir ir;
    memory_init(&memory, UINT64_MAX);
    test_model_make(&shape, 3, &model);
    for (uint32_t r = 0; r < 3; r++)
        model.canonical.references[r].bounds = (struct box){{-0.1f, -3.3f, 0.7f}, {0.9f, 1.1f, 1.3f + (float)r}};
    build_ir_for(TARGET_LAVAPIPE, &model.canonical, &memory, &ir);
    for (uint32_t i = 0; i < ir.node_count; i++) {
        if (!ir_is_leaf(&ir, i))
            continue;
        struct canonical_instance instance =
            canonical_instance(&model.canonical.geometries[0], ir.refs[ir.nodes[i].first]);
        struct box box = drivers_box(instance.transform, &model.canonical.references[instance.reference - 1].bounds);
        struct box same = lavapipe_bounds_leaf(&model.canonical, ir.refs[ir.nodes[i].first]);
        assert_memory_equal(&box, &same, sizeof box);
        assert_true(box_contains(&ir.boxes[0][i], &box));
    }
    ir_finish(&ir);
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

/* Boxes stay finite even under a matrix that overflows. */
static void boxes_stay_finite(void **state)
{
    (void)state;
    unsigned char records[2][64] = {{0}};
    const float large[12] = {3e38f, 3e38f, 0, 3e38f, 1, 0, 0, 0, 0, 0, 1, 0},
                unit[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    memcpy(records[0], large, sizeof large);
    memcpy(records[1], unit, sizeof unit);
    for (int i = 0; i < 2; i++)
        bytes_put64(records[i] + 56, 1);
    struct canonical_geometry geometry = {.type = GEOMETRY_INSTANCES, .primitive_count = 2, .instances = records[0]};
    struct canonical_reference reference = {.kind = REFERENCE_BLAS, .bounds = {{-2, -2, -2}, {2, 2, 2}}};
    struct canonical canonical = {.type = STRUCTURE_TOP,
                                  .geometry_count = 1,
                                  .reference_count = 1,
                                  .primitive_count = 2,
                                  .geometries = &geometry,
                                  .references = &reference};
    struct memory memory;
    struct ir ir;
    memory_init(&memory, UINT64_MAX);
    build_ir_for(TARGET_LAVAPIPE, &canonical, &memory, &ir);
    for (uint32_t i = 0; i < ir.node_count; i++)
        for (int axis = 0; axis < 3; axis++)
            assert_true(isfinite(ir.boxes[0][i].min[axis]) && isfinite(ir.boxes[0][i].max[axis]));
    ir_finish(&ir);
    assert_int_equal(memory.live, 0);
}

static void a_set_flag_stops_it(void **state)
{
    (void)state;
    struct test_model model;
    struct memory memory;
    struct ir ir;
    atomic_bool cancel = true;
    memory_init(&memory, UINT64_MAX);
    make_split_model(&model);
    assert_int_equal(test_ir_make(model.boxes, model.canonical.primitive_count, 1, &memory, &ir), BVHD_OK);
    assert_false(lavapipe_bounds_inflate(&model.canonical, &parallel_serial, &cancel, &ir));
    struct ir none = {.key_count = 1};
    assert_true(lavapipe_bounds_inflate(&model.canonical, &parallel_serial, NULL, &none));
    ir_finish(&ir);
    test_model_finish(&model);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(parts_grow_within_their_triangles),
        cmocka_unit_test(builds_inflate_split_references),
        cmocka_unit_test(instances_contain_what_the_driver_computes),
        cmocka_unit_test(boxes_stay_finite),
        cmocka_unit_test(a_set_flag_stops_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
