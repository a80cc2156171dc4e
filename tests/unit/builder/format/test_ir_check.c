/* SPDX-License-Identifier: Apache-2.0 */
/* test_ir_check.c - tests that ir_check() finds every broken invariant, and the cost and depth of trees. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/ir.h"
#include "tests/support/builder/test_ir.h"

static const struct test_shape cloud = {
    .type = GEOMETRY_AABBS, .geometries = 1, .primitives = 40, .size = 10, .detail = 0.1};

/* A valid tree, for a test to break. */
struct fixture {
    struct memory memory;
    struct test_model model;
    struct ir ir;
};

static void start(struct fixture *fixture, uint32_t inactive)
{
    struct test_shape shape = cloud;
    shape.inactive = inactive;
    memory_init(&fixture->memory, UINT64_MAX);
    test_model_make(&shape, 7, &fixture->model);
    assert_int_equal(test_ir_make(fixture->model.boxes, 40, 3, &fixture->memory, &fixture->ir), BVHD_OK);
    assert_true(inactive == 1 || fixture->ir.node_count > 12);
}

static enum bvhd_status check(struct fixture *fixture, bool allow_split, struct bvhd_error *error)
{
    return ir_check(&fixture->ir, 40, fixture->model.boxes, allow_split, &fixture->memory, error);
}

static void finish(struct fixture *fixture)
{
    ir_finish(&fixture->ir);
    test_model_finish(&fixture->model);
    assert_int_equal(fixture->memory.live, 0);
}

static uint32_t first_leaf(const struct ir *ir)
{
    uint32_t node = 0;
    while (!ir_is_leaf(ir, node))
        node++;
    return node;
}

static uint32_t last_inner(const struct ir *ir)
{
    uint32_t node = ir->node_count - 1;
    while (ir_is_leaf(ir, node))
        node--;
    return node;
}

static void a_sound_tree_passes(void **state)
{
    (void)state;
    for (uint32_t inactive = 0; inactive < 5; inactive++) {
        struct fixture fixture;
        start(&fixture, inactive);
        assert_int_equal(check(&fixture, false, NULL), BVHD_OK);
        assert_int_equal(check(&fixture, true, NULL), BVHD_OK);
        assert_int_equal(ir_check(&fixture.ir, 40, NULL, false, &fixture.memory, NULL), BVHD_OK);
        finish(&fixture);
    }
}

static void break_children_order(struct fixture *f)
{
    f->ir.nodes[last_inner(&f->ir)].first = 0;
}

static void break_children_outside(struct fixture *f)
{
    f->ir.nodes[0].first = f->ir.node_count - 1;
}

static void break_two_parents(struct fixture *f)
{
    f->ir.nodes[last_inner(&f->ir)].first = f->ir.nodes[0].first;
    f->ir.nodes[0].first = f->ir.nodes[last_inner(&f->ir)].first;
}

static void break_orphan(struct fixture *f)
{
    /* The root becomes a leaf with all refs. */
    f->ir.nodes[0] = (struct ir_node){0, f->ir.ref_count};
}

static void break_box_nan(struct fixture *f)
{
    f->ir.boxes[0][first_leaf(&f->ir)].min[1] = NAN;
}

static void break_box_infinite(struct fixture *f)
{
    f->ir.boxes[0][0].max[2] = INFINITY;
}

static void break_box_empty(struct fixture *f)
{
    f->ir.boxes[0][first_leaf(&f->ir)] = box_empty();
}

static void break_box_small(struct fixture *f)
{
    struct box *box = &f->ir.boxes[0][last_inner(&f->ir)];
    box->max[0] = nextafterf(box->max[0], -INFINITY);
}

static void break_leaf_box_small(struct fixture *f)
{
    struct box *box = &f->ir.boxes[0][first_leaf(&f->ir)];
    box->min[0] = nextafterf(box->min[0], INFINITY);
}

static void break_refs_outside(struct fixture *f)
{
    f->ir.nodes[first_leaf(&f->ir)].first = f->ir.ref_count;
}

static void break_refs_overlap(struct fixture *f)
{
    uint32_t leaf = first_leaf(&f->ir);
    f->ir.nodes[leaf].first += f->ir.nodes[leaf].first == 0 ? 1 : UINT32_MAX;
}

static void break_ref_unknown(struct fixture *f)
{
    f->ir.refs[5] = 40;
}

static void break_ref_twice(struct fixture *f)
{
    f->ir.refs[5] = f->ir.refs[4];
}

static void break_ref_inactive(struct fixture *f)
{
    f->model.boxes[f->ir.refs[3]] = box_empty();
}

static void break_cover(struct fixture *f)
{
    f->ir.ref_count++;
}

static void break_keys(struct fixture *f)
{
    f->ir.key_count = 3;
}

static void break_no_nodes(struct fixture *f)
{
    f->ir.node_count = 0;
}

static void every_broken_invariant_is_found(void **state)
{
    (void)state;
    static void (*const breaks[])(struct fixture *) = {
        break_children_order, break_children_outside, break_two_parents,  break_orphan,       break_box_nan,
        break_box_infinite,   break_box_empty,        break_box_small,    break_refs_outside, break_refs_overlap,
        break_ref_unknown,    break_ref_twice,        break_ref_inactive, break_cover,        break_keys,
        break_no_nodes,       break_leaf_box_small,
    };
    for (size_t i = 0; i < sizeof breaks / sizeof *breaks; i++) {
        struct fixture fixture;
        struct bvhd_error error;
        start(&fixture, 0);
        breaks[i](&fixture);
        assert_int_equal(check(&fixture, false, &error), BVHD_INTERNAL);
        finish(&fixture);
    }
}

static void a_missing_primitive_is_found(void **state)
{
    (void)state;
    struct fixture fixture;
    start(&fixture, 2);
    fixture.model.boxes[0] = fixture.model.boxes[1];
    assert_int_equal(check(&fixture, false, NULL), BVHD_INTERNAL);
    finish(&fixture);
}

/* With split references a primitive may be in several leaves, each of which holds a part of it. */
static void splits_are_allowed_when_told(void **state)
{
    (void)state;
    struct memory memory;
    struct ir ir;
    struct box boxes[2] = {{{0, 0, 0}, {4, 1, 1}}, {{0, 0, 0}, {1, 1, 1}}};
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(ir_init(&ir, &memory, 3, 3, NULL), BVHD_OK);
    ir.node_count = ir.ref_count = 3;
    ir.nodes[0] = (struct ir_node){.first = 1};
    ir.nodes[1] = (struct ir_node){.first = 0, .count = 2};
    ir.nodes[2] = (struct ir_node){.first = 2, .count = 1};
    ir.boxes[0][0] = boxes[0];
    ir.boxes[0][1] = (struct box){{0, 0, 0}, {2, 1, 1}};
    ir.boxes[0][2] = (struct box){{2, 0, 0}, {4, 1, 1}};
    ir.refs[0] = ir.refs[2] = 0;
    ir.refs[1] = 1;
    assert_int_equal(ir_check(&ir, 2, boxes, true, &memory, NULL), BVHD_OK);
    assert_int_equal(ir_check(&ir, 2, boxes, false, &memory, NULL), BVHD_INTERNAL);
    ir.boxes[0][2].min[0] = 4.5f;
    ir.boxes[0][2].max[0] = ir.boxes[0][0].max[0] = 5;
    assert_int_equal(ir_check(&ir, 2, boxes, true, &memory, NULL), BVHD_INTERNAL);
    ir_finish(&ir);
    assert_int_equal(memory.live, 0);
}

static void the_empty_tree(void **state)
{
    (void)state;
    struct memory memory;
    struct ir ir;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(ir_init(&ir, &memory, 0, 0, NULL), BVHD_OK);
    assert_int_equal(ir_check(&ir, 0, NULL, false, &memory, NULL), BVHD_OK);
    assert_int_equal(ir_depth(&ir, &memory), 0);
    assert_true(ir_sah(&ir) == 0);
    ir_finish(&ir);
    ir_finish(&ir);
    ir_finish(NULL);
    assert_int_equal(memory.live, 0);
}

static double cost_below(const struct ir *ir, uint32_t node, uint32_t level, uint32_t *depth)
{
    const struct box *b = &ir->boxes[0][node];
    double x = (double)b->max[0] - b->min[0], y = (double)b->max[1] - b->min[1], z = (double)b->max[2] - b->min[2];
    double area = x * y + x * z + y * z;
    *depth = level > *depth ? level : *depth;
    if (ir_is_leaf(ir, node))
        return area * ir->nodes[node].count;
    return area + cost_below(ir, ir->nodes[node].first, level + 1, depth) +
           cost_below(ir, ir->nodes[node].first + 1, level + 1, depth);
}

static void sah_and_depth_are_as_by_recursion(void **state)
{
    (void)state;
    struct fixture fixture;
    start(&fixture, 0);
    uint32_t depth = 0, levels[100];
    double cost = cost_below(&fixture.ir, 0, 1, &depth), root = box_half_area(&fixture.ir.boxes[0][0]);
    assert_true(fabs(ir_sah(&fixture.ir) - cost / root) < 1e-12 * cost / root);
    assert_true(fabs(ir_cost(&fixture.ir, 0, 5) + ir_cost(&fixture.ir, 5, fixture.ir.node_count) - cost) <
                1e-12 * cost);
    assert_int_equal(ir_depth(&fixture.ir, &fixture.memory), depth);
    assert_int_equal(ir_levels(&fixture.ir, levels), depth);
    finish(&fixture);
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    struct fixture fixture;
    struct ir ir;
    start(&fixture, 0);
    uint64_t live = fixture.memory.live;
    for (int64_t n = 0; n < 3; n++) {
        fixture.memory.fail_after = n;
        assert_int_equal(ir_init(&ir, &fixture.memory, 5, 5, NULL), BVHD_NO_MEMORY);
        assert_int_equal(fixture.memory.live, live);
        fixture.memory.fail_after = n;
        assert_int_equal(check(&fixture, false, NULL), BVHD_NO_MEMORY);
        assert_int_equal(fixture.memory.live, live);
    }
    fixture.memory.fail_after = 0;
    assert_true(ir_depth(&fixture.ir, &fixture.memory) == IR_DEPTH_UNKNOWN);
    finish(&fixture);
}

/* A second key is checked as the first one is, and counts in the cost as much. */
static void both_keys_are_checked(void **state)
{
    (void)state;
    struct fixture f;
    struct box boxes[80];
    struct bvhd_error error;
    start(&f, 0);
    const size_t size = f.ir.node_count * sizeof *f.ir.boxes[0];
    const double sah = ir_sah(&f.ir), cost = ir_cost(&f.ir, 0, f.ir.node_count);
    f.ir.boxes[1] = memory_alloc(&f.memory, size);
    assert_non_null(f.ir.boxes[1]);
    memcpy(f.ir.boxes[1], f.ir.boxes[0], size);
    f.ir.key_count = 2;
    memcpy(boxes, f.model.boxes, sizeof boxes / 2);
    memcpy(boxes + 40, f.model.boxes, sizeof boxes / 2);
    assert_int_equal(ir_check(&f.ir, 40, boxes, false, &f.memory, &error), BVHD_OK);
    assert_true(fabs(ir_sah(&f.ir) - sah) < 1e-12 * sah);
    assert_true(fabs(ir_cost(&f.ir, 0, f.ir.node_count) - 2 * cost) < 1e-12 * cost);
    const uint32_t leaf = first_leaf(&f.ir), inner = last_inner(&f.ir);
    boxes[40 + f.ir.refs[f.ir.nodes[leaf].first]].max[1] += 1000;
    assert_int_equal(ir_check(&f.ir, 40, boxes, false, &f.memory, &error), BVHD_INTERNAL);
    assert_string_equal(error.text, "the leaf's box does not hold a primitive");
    f.ir.boxes[1][inner].min[2] += 1000;
    f.ir.boxes[1][inner].max[2] += 1000;
    assert_int_equal(ir_check(&f.ir, 40, NULL, false, &f.memory, &error), BVHD_INTERNAL);
    assert_string_equal(error.text, "the box does not hold a child's box");
    finish(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sound_tree_passes),
        cmocka_unit_test(every_broken_invariant_is_found),
        cmocka_unit_test(a_missing_primitive_is_found),
        cmocka_unit_test(splits_are_allowed_when_told),
        cmocka_unit_test(the_empty_tree),
        cmocka_unit_test(sah_and_depth_are_as_by_recursion),
        cmocka_unit_test(both_keys_are_checked),
        cmocka_unit_test(failing_allocations_leave_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
