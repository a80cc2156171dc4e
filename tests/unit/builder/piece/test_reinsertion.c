/* SPDX-License-Identifier: Apache-2.0 */
/* test_reinsertion.c - tests that reinsertion keeps trees sound, lowers their cost, and takes a bounded time. */
#include "tests/support/unit.h"

#include "builder/piece/reinsertion.h"
#include "builder/piece/spatial.h"
#include "tests/support/builder/spatial_triangles.h"

static struct ir spatial_tree(struct triangles *f)
{
    struct spatial_request request = {.canonical = &f->canonical,
                                      .refs = f->refs,
                                      .scratch = f->scratch,
                                      .count = f->count,
                                      .capacity = f->capacity,
                                      .price = triangles_price(f)};
    struct ir ir;
    assert_int_equal(spatial_build(&request, &f->memory, &ir, NULL), BVHD_OK);
    return ir;
}

/* Makes a bad tree: halved in the order of the ids, which is random; with `chain`, one ref after the other. */
static struct ir bad_tree(struct triangles *f, bool chain)
{
    struct ir ir;
    assert_int_equal(ir_init(&ir, &f->memory, 2 * f->count - 1, f->count, NULL), BVHD_OK);
    uint32_t *firsts = calloc(2 * (size_t)f->count, sizeof *firsts),
             *counts = calloc(2 * (size_t)f->count, sizeof *counts);
    assert_true(firsts && counts);
    counts[0] = f->count;
    ir.node_count = 1;
    ir.ref_count = f->count;
    for (uint32_t i = 0; i < ir.node_count; i++) {
        ir.boxes[0][i] = box_empty();
        for (uint32_t k = firsts[i]; k < firsts[i] + counts[i]; k++)
            box_grow(&ir.boxes[0][i], &f->boxes[k]);
        ir.refs[firsts[i]] = firsts[i];
        ir.nodes[i] = (struct ir_node){firsts[i], 1};
        if (counts[i] == 1)
            continue;
        uint32_t pair = ir.node_count, left = chain ? 1 : counts[i] / 2;
        ir.nodes[i] = (struct ir_node){pair, 0};
        firsts[pair] = firsts[i], counts[pair] = left;
        firsts[pair + 1] = firsts[i] + left, counts[pair + 1] = counts[i] - left;
        ir.node_count += 2;
    }
    free(firsts);
    free(counts);
    return ir;
}

static struct ir copy_of(const struct ir *ir, struct memory *memory)
{
    struct ir copy;
    assert_int_equal(ir_init(&copy, memory, ir->node_count, ir->ref_count, NULL), BVHD_OK);
    memcpy(copy.nodes, ir->nodes, ir->node_count * sizeof *ir->nodes);
    memcpy(copy.boxes[0], ir->boxes[0], ir->node_count * sizeof *ir->boxes[0]);
    memcpy(copy.refs, ir->refs, ir->ref_count * sizeof *ir->refs);
    copy.node_count = ir->node_count;
    copy.ref_count = ir->ref_count;
    return copy;
}

static struct ir run_with(struct triangles *f, const struct ir *from, uint32_t leaf_max, uint32_t passes, float share,
                          float last_share)
{
    struct ir copy = copy_of(from, &f->memory);
    struct reinsertion_request request = {
        .ir = &copy, .leaf_max = leaf_max, .passes = passes, .share = share, .last_share = last_share};
    struct ir ir;
    assert_int_equal(reinsertion_run(&request, &f->memory, &ir, NULL), BVHD_OK);
    return ir;
}

static struct ir run(struct triangles *f, const struct ir *from, uint32_t leaf_max, uint32_t passes, float share)
{
    return run_with(f, from, leaf_max, passes, share, share);
}

/*
 * Checks that no subtree of at most leaf_max refs names a primitive twice, because collapsing may make it a leaf.
 * Returns the number of refs in the tree.
 */
static uint32_t check_names(const struct ir *ir, uint32_t leaf_max, uint32_t *firsts)
{
    uint32_t *counts = calloc(ir->node_count, sizeof *counts);
    assert_non_null(counts);
    for (uint32_t i = ir->node_count; i-- > 0;) {
        const struct ir_node *node = &ir->nodes[i];
        counts[i] = node->count ? node->count : counts[node->first] + counts[node->first + 1];
        firsts[i] = node->count || firsts[node->first] < firsts[node->first + 1]
                        ? (node->count ? node->first : firsts[node->first])
                        : firsts[node->first + 1];
        assert_true(node->count <= leaf_max);
        for (uint32_t k = 0; counts[i] <= leaf_max && k < counts[i]; k++)
            for (uint32_t j = 0; j < k; j++)
                assert_int_not_equal(ir->refs[firsts[i] + k], ir->refs[firsts[i] + j]);
    }
    uint32_t all = counts[0];
    free(counts);
    return all;
}

static void check(const struct triangles *f, const struct ir *ir, uint32_t leaf_max)
{
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(ir_check(ir, f->count, f->boxes, true, &memory, NULL), BVHD_OK);
    uint32_t *firsts = calloc(ir->node_count, sizeof *firsts);
    struct use *uses = calloc(ir->ref_count, sizeof *uses);
    assert_true(firsts && uses);
    assert_int_equal(check_names(ir, leaf_max, firsts), ir->ref_count);
    for (uint32_t i = 0; i < ir->node_count; i++)
        for (uint32_t k = 0; k < ir->nodes[i].count; k++) {
            uint32_t at = ir->nodes[i].first + k, id = ir->refs[at];
            struct box box = ir->boxes[0][i];
            for (int axis = 0; axis < 3; axis++) {
                box.min[axis] = fmaxf(box.min[axis], f->boxes[id].min[axis]);
                box.max[axis] = fminf(box.max[axis], f->boxes[id].max[axis]);
            }
            uses[at] = (struct use){id, box};
        }
    triangles_check(f, uses, ir->ref_count);
    free(firsts);
    free(uses);
}

static void every_tree_stays_sound(void **state)
{
    (void)state;
    for (int kind = 0; kind < KINDS; kind++)
        for (uint32_t count = 1; count < 2000; count = count * 3 + (count < 9))
            for (uint32_t leaf_max = 1; leaf_max <= REINSERTION_LEAF_MOST; leaf_max++) {
                struct triangles f;
                triangles_start(&f, (enum kind)kind, count, count / 4);
                struct ir from = spatial_tree(&f), to = run(&f, &from, leaf_max, 2, 0.5f);
                check(&f, &to, leaf_max);
                assert_true(to.ref_count <= from.ref_count);
                ir_finish(&from);
                ir_finish(&to);
                triangles_finish(&f);
            }
}

static void cost_goes_down(void **state)
{
    (void)state;
    for (int kind = 0; kind < KINDS; kind++) {
        struct triangles f;
        triangles_start(&f, (enum kind)kind, 2000, 400);
        struct ir from = spatial_tree(&f), once = run(&f, &from, 1, 1, 1), often = run(&f, &from, 1, 4, 1),
                  large = run(&f, &from, 3, 1, 1);
        assert_true(ir_sah(&once) <= ir_sah(&from) * 1.00001);
        assert_true(ir_sah(&often) <= ir_sah(&once) * 1.00001);
        assert_true(ir_sah(&large) <= ir_sah(&once) * 1.00001);
        if (kind == CLOUD || kind == FAR)
            assert_true(ir_sah(&often) < 0.99 * ir_sah(&from));
        ir_finish(&from);
        ir_finish(&once);
        ir_finish(&often);
        ir_finish(&large);
        triangles_finish(&f);
    }
}

/* A pass with a share of 0 does nothing, and the last pass has its own share. */
static void the_last_pass_has_its_share(void **state)
{
    (void)state;
    struct triangles f;
    triangles_start(&f, FAR, 1000, 0);
    struct ir bad = bad_tree(&f, false), once = run(&f, &bad, 1, 1, 1), twice = run(&f, &bad, 1, 2, 1);
    assert_true(ir_sah(&twice) < ir_sah(&once) && ir_sah(&once) < ir_sah(&bad));
    for (uint32_t passes = 1; passes <= 3; passes++) {
        struct ir last = run_with(&f, &bad, 1, passes, 0, 1), first = run_with(&f, &bad, 1, passes, 1, 0);
        assert_true(ir_sah(&last) == ir_sah(&once));
        assert_true(ir_sah(&first) == ir_sah(passes == 1 ? &bad : passes == 2 ? &once : &twice));
        ir_finish(&last);
        ir_finish(&first);
    }
    ir_finish(&bad);
    ir_finish(&once);
    ir_finish(&twice);
    triangles_finish(&f);
}

static void bad_trees_become_good(void **state)
{
    (void)state;
    for (int chain = 0; chain < 2; chain++) {
        struct triangles f;
        triangles_start(&f, FAR, 1000, 0);
        struct ir good = spatial_tree(&f), bad = bad_tree(&f, chain), better = run(&f, &bad, 1, 8, 1);
        check(&f, &better, 1);
        assert_true(ir_sah(&bad) > 5 * ir_sah(&good));
        assert_true(ir_sah(&better) < 0.4 * ir_sah(&bad));
        ir_finish(&good);
        ir_finish(&bad);
        ir_finish(&better);
        triangles_finish(&f);
    }
}

/* In a chain each path up or down is as long as the tree is deep. */
static void deep_trees_take_no_longer(void **state)
{
    (void)state;
    struct triangles f;
    triangles_start(&f, SIZES, 6000, 0);
    struct ir chain = bad_tree(&f, true), to = run(&f, &chain, 3, 2, 1);
    check(&f, &to, 3);
    assert_true(ir_sah(&to) < ir_sah(&chain));
    ir_finish(&chain);
    ir_finish(&to);
    triangles_finish(&f);
}

/* Parts of one triangle that meet in a leaf count once, however many there are. */
static void parts_that_meet_are_named_once(void **state)
{
    (void)state;
    struct triangles f;
    triangles_start(&f, CLOUD, 64, 0);
    struct ir from = bad_tree(&f, false);
    for (uint32_t leaf_max = 1; leaf_max <= REINSERTION_LEAF_MOST; leaf_max++) {
        for (uint32_t i = 0; i < 64; i++)
            from.refs[i] = i < 32 ? i % 2 : 2;
        struct ir to = run(&f, &from, leaf_max, 0, 1);
        assert_int_equal(to.ref_count, leaf_max == 1 ? 33 : 3);
        assert_int_equal(to.node_count, leaf_max == 1 ? 65 : leaf_max == 2 ? 3 : 1);
        ir_finish(&to);
    }
    ir_finish(&from);
    triangles_finish(&f);
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    enum bvhd_status status = BVHD_NO_MEMORY;
    struct triangles f;
    triangles_start(&f, SLIVERS, 100, 20);
    struct ir from = spatial_tree(&f), to;
    uint64_t live = f.memory.live;
    for (int64_t n = 0; status != BVHD_OK; n++) {
        struct bvhd_error error = {.status = BVHD_OK};
        struct ir copy = copy_of(&from, &f.memory);
        struct reinsertion_request request = {.ir = &copy, .leaf_max = 3, .passes = 1, .last_share = 0.5f};
        f.memory.fail_after = n;
        status = reinsertion_run(&request, &f.memory, &to, &error);
        assert_true(n < 6 ? status == BVHD_NO_MEMORY : status == BVHD_OK);
        assert_int_equal(error.status, status);
        ir_finish(&copy);
        if (status != BVHD_OK)
            assert_int_equal(f.memory.live, live);
    }
    ir_finish(&from);
    ir_finish(&to);
    triangles_finish(&f);
}

static void cancelling_ends_it(void **state)
{
    (void)state;
    struct triangles f;
    struct ir to;
    struct bvhd_error error;
    atomic_bool cancel = true;
    triangles_start(&f, CLOUD, 1000, 0);
    struct ir from = spatial_tree(&f);
    struct reinsertion_request request = {
        .ir = &from, .leaf_max = 3, .passes = 1, .last_share = 0.5f, .cancel = &cancel};
    assert_int_equal(reinsertion_run(&request, &f.memory, &to, &error), BVHD_CANCELLED);
    assert_int_equal(error.status, BVHD_CANCELLED);
    ir_finish(&from);
    triangles_finish(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_tree_stays_sound),
        cmocka_unit_test(cost_goes_down),
        cmocka_unit_test(the_last_pass_has_its_share),
        cmocka_unit_test(bad_trees_become_good),
        cmocka_unit_test(deep_trees_take_no_longer),
        cmocka_unit_test(parts_that_meet_are_named_once),
        cmocka_unit_test(failing_allocations_leave_nothing),
        cmocka_unit_test(cancelling_ends_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
