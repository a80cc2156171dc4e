/* SPDX-License-Identifier: Apache-2.0 */
/* test_depth.c - tests that depth_limit() keeps any possible limit, and changes no more of the tree than it has to. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/depth.h"
#include "tests/support/builder/test_ir.h"

/*
 * Makes a random tree over `leaves` leaves of 1 to 3 refs: each inner node puts a share of about `skew` of its leaves
 * on one side.
 */
struct maker {
    struct ir *ir;
    struct random random;
    double skew;
};

static void grow(struct maker *maker, uint32_t node, uint32_t leaves)
{
    struct ir *ir = maker->ir;
    if (leaves == 1) {
        uint32_t count = 1 + (uint32_t)(random_next(&maker->random) % 3);
        ir->nodes[node] = (struct ir_node){ir->ref_count, count};
        struct box box = box_empty();
        for (uint32_t i = 0; i < count; i++) {
            double point[3];
            random_point(&maker->random, point);
            box_add_point(&box, (float[]){(float)point[0], (float)point[1], (float)point[2]});
            ir->refs[ir->ref_count] = ir->ref_count;
            ir->ref_count++;
        }
        ir->boxes[0][node] = ir->boxes[1][node] = box;
        ir->boxes[1][node].max[0] += 1;
        return;
    }
    uint32_t pair = ir->node_count, left = (uint32_t)(leaves * maker->skew);
    left = left < 1 ? 1 : left >= leaves ? leaves - 1 : left;
    bool flip = random_next(&maker->random) % 2;
    ir->node_count += 2;
    ir->nodes[node] = (struct ir_node){.first = pair};
    /* Either child may have the lower refs. */
    grow(maker, pair + flip, left);
    grow(maker, pair + !flip, leaves - left);
    for (uint32_t key = 0; key < 2; key++) {
        ir->boxes[key][node] = ir->boxes[key][pair];
        box_grow(&ir->boxes[key][node], &ir->boxes[key][pair + 1]);
    }
}

static void make_tree(uint32_t leaves, double skew, uint64_t seed, struct memory *memory, struct ir *ir)
{
    struct maker maker = {ir, {seed}, skew};
    assert_int_equal(ir_init(ir, memory, 2 * leaves - 1, 3 * leaves, NULL), BVHD_OK);
    ir->boxes[1] = memory_array(memory, 2 * leaves - 1, sizeof *ir->boxes[1]);
    assert_non_null(ir->boxes[1]);
    ir->key_count = 2;
    ir->node_count = 1;
    grow(&maker, 0, leaves);
    assert_int_equal(ir->node_count, 2 * leaves - 1);
}

static uint32_t log2_up(uint32_t n)
{
    uint32_t levels = 0;
    while ((UINT64_C(1) << levels) < n)
        levels++;
    return levels;
}

static void any_limit_that_is_possible_is_kept(void **state)
{
    (void)state;
    static const double skews[] = {0, 0.03, 0.2, 0.5};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (uint32_t leaves = 1; leaves < 700; leaves += 1 + leaves / 3)
        for (int s = 0; s < 4; s++) {
            uint32_t least = log2_up(leaves) + 1;
            for (uint32_t limit = least; limit < least + 40; limit += 1 + (limit - least) / 2) {
                struct ir ir;
                make_tree(leaves, skews[s], leaves, &memory, &ir);
                uint32_t refs[2100], nodes = ir.node_count, count = ir.ref_count, before = ir_depth(&ir, &memory);
                double sah = ir_sah(&ir);
                memcpy(refs, ir.refs, count * sizeof *refs);
                uint32_t depth = 0;
                assert_int_equal(depth_limit(&ir, limit, NULL, &depth, NULL), BVHD_OK);
                assert_int_equal(ir_check(&ir, count, NULL, false, &memory, NULL), BVHD_OK);
                assert_int_equal(depth, ir_depth(&ir, &memory));
                assert_true(depth <= limit);
                assert_int_equal(ir.node_count, nodes);
                assert_int_equal(ir.ref_count, count);
                assert_memory_equal(ir.refs, refs, count * sizeof *refs);
                if (before <= limit)
                    assert_true(depth == before && ir_sah(&ir) == sah);
                ir_finish(&ir);
            }
        }
    assert_int_equal(memory.live, 0);
}

/* Of two subtrees only the too deep one is changed; the other one stays as it is, node for node. */
static void the_shallow_part_is_not_touched(void **state)
{
    (void)state;
    struct memory memory;
    struct ir deep, ir;
    struct maker maker = {&ir, {1}, 0.5};
    memory_init(&memory, UINT64_MAX);
    make_tree(100, 0, 5, &memory, &deep);
    assert_int_equal(ir_init(&ir, &memory, 600, 900, NULL), BVHD_OK);
    ir.boxes[1] = memory_array(&memory, 600, sizeof *ir.boxes[1]);
    ir.key_count = 2;
    ir.node_count = 3;
    ir.nodes[0] = (struct ir_node){.first = 1};
    grow(&maker, 1, 100);
    uint32_t shallow_end = ir.node_count;
    maker.skew = 0;
    grow(&maker, 2, 100);
    for (uint32_t key = 0; key < 2; key++) {
        ir.boxes[key][0] = ir.boxes[key][1];
        box_grow(&ir.boxes[key][0], &ir.boxes[key][2]);
    }
    assert_int_equal(ir_check(&ir, 900, NULL, false, &memory, NULL), BVHD_OK);
    struct ir_node before[300];
    memcpy(before, ir.nodes, shallow_end * sizeof *before);
    uint32_t depth;
    assert_int_equal(depth_limit(&ir, 20, NULL, &depth, NULL), BVHD_OK);
    assert_int_equal(ir_check(&ir, 900, NULL, false, &memory, NULL), BVHD_OK);
    assert_true(ir_depth(&ir, &memory) <= 20 && ir_depth(&ir, &memory) > 9);
    for (uint32_t i = 0; i < shallow_end; i++)
        if (i != 2)
            assert_memory_equal(&ir.nodes[i], &before[i], sizeof *before);
    ir_finish(&ir);
    ir_finish(&deep);
    assert_int_equal(memory.live, 0);
}

static void too_many_leaves_are_refused(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (uint32_t leaves = 2; leaves < 300; leaves++) {
        struct ir ir;
        struct ir_node before[600];
        make_tree(leaves, 0.1, 3, &memory, &ir);
        memcpy(before, ir.nodes, ir.node_count * sizeof *before);
        uint32_t depth = 77;
        assert_int_equal(depth_limit(&ir, log2_up(leaves), NULL, &depth, NULL), BVHD_TOO_LARGE);
        assert_int_equal(depth, 77);
        assert_memory_equal(ir.nodes, before, ir.node_count * sizeof *before);
        ir_finish(&ir);
    }
    assert_int_equal(memory.live, 0);
}

static void a_very_long_path(void **state)
{
    (void)state;
    struct memory memory;
    struct ir ir;
    memory_init(&memory, UINT64_MAX);
    make_tree(5000, 0, 8, &memory, &ir);
    assert_int_equal(ir_depth(&ir, &memory), 5000);
    uint32_t depth;
    assert_int_equal(depth_limit(&ir, 64, NULL, &depth, NULL), BVHD_OK);
    assert_int_equal(ir_check(&ir, ir.ref_count, NULL, false, &memory, NULL), BVHD_OK);
    assert_true(ir_depth(&ir, &memory) <= 64);
    ir_finish(&ir);
    assert_int_equal(memory.live, 0);
}

static void failing_allocations_leave_the_tree(void **state)
{
    (void)state;
    struct memory memory;
    struct ir ir = {.key_count = 1, .memory = &memory};
    memory_init(&memory, UINT64_MAX);
    uint32_t depth = 77;
    assert_int_equal(depth_limit(&ir, 1, NULL, &depth, NULL), BVHD_OK);
    assert_int_equal(depth, 0);
    make_tree(50, 0, 8, &memory, &ir);
    for (int64_t n = 0; n < 4; n++) {
        uint64_t live = memory.live;
        memory.fail_after = n;
        assert_int_equal(depth_limit(&ir, 10, NULL, &depth, NULL), BVHD_NO_MEMORY);
        assert_int_equal(memory.live, live);
        assert_int_equal(ir_depth(&ir, &memory), 50);
    }
    ir_finish(&ir);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_limit_that_is_possible_is_kept), cmocka_unit_test(the_shallow_part_is_not_touched),
        cmocka_unit_test(too_many_leaves_are_refused),        cmocka_unit_test(a_very_long_path),
        cmocka_unit_test(failing_allocations_leave_the_tree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
