/* SPDX-License-Identifier: Apache-2.0 */
/* test_cluster_tree.c - tests that trees joined by ploc_join and binned_join are sound, good by SAH, and end soon. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/piece/binned.h"
#include "builder/piece/ploc.h"
#include "tests/support/builder/test_ir.h"
#include "tests/support/builder/test_refs.h"

struct way {
    cluster_joiner *join;
    uint32_t leaf_max;
    float cut_cost;
};

/* The settings of the build qualities, with leaves of several primitives and of one, and other values. */
static const struct way ways[] = {{ploc_join, 3, 4},      {ploc_join, 1, 4},      {ploc_join, 31, 2},
                                  {binned_join, 3, 0.8f}, {binned_join, 1, 0.8f}, {binned_join, 31, 2},
                                  {binned_join, 2, 0.1f}};
enum { WAYS = sizeof ways / sizeof *ways };

static enum bvhd_status run(struct primitive_ref *refs, uint32_t count, const struct way *way,
                            const atomic_bool *cancel, struct memory *memory, struct ir *ret_ir,
                            struct bvhd_error *error)
{
    struct primitive_ref *scratch = test_refs_make(REFS_SAME, count, 0);
    struct cluster_request request = {
        .refs = refs,
        .scratch = scratch,
        .count = count,
        .leaf_max = way->leaf_max,
        .cut_cost = way->cut_cost,
        .fills_leaves = way->join == ploc_join,
        .cancel = cancel,
    };
    uint32_t depth;
    double cost;
    enum bvhd_status status = cluster_tree_build(&request, way->join, memory, ret_ir, &depth, &cost, error);
    if (status == BVHD_OK) {
        double expected = ir_cost(ret_ir, 0, ret_ir->node_count);
        struct memory own;
        memory_init(&own, UINT64_MAX);
        assert_int_equal(depth, ir_depth(ret_ir, &own));
        assert_true(fabs(cost - expected) <= 1e-12 * expected);
    }
    free(scratch);
    return status;
}

static void every_kind_gives_a_sound_tree(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (uint32_t count = 1; count < 20000; count = count * 2 + (count < 9))
            for (size_t w = 0; w < WAYS; w++) {
                struct ir ir;
                struct primitive_ref *refs = test_refs_make((enum test_refs_kind)kind, count, count);
                struct box *boxes = test_refs_boxes(refs, count);
                assert_int_equal(run(refs, count, &ways[w], NULL, &memory, &ir, NULL), BVHD_OK);
                assert_int_equal(ir_check(&ir, count, boxes, false, &memory, NULL), BVHD_OK);
                assert_int_equal(ir.ref_count, count);
                for (uint32_t i = 0; i < ir.node_count; i++)
                    assert_true(ir.nodes[i].count <= ways[w].leaf_max);
                if (kind == REFS_SAME)
                    assert_true(ir_depth(&ir, &memory) <= 3 + ceil(log2(count)));
                ir_finish(&ir);
                free(boxes);
                free(refs);
            }
    assert_int_equal(memory.live, 0);
}

/* Distances grow steadily, so the nearest box is always the one before, and a round makes few pairs. */
static void a_row_without_pairs_ends_soon(void **state)
{
    (void)state;
    enum { COUNT = 16384 };
    struct memory memory;
    struct ir ir;
    static const struct way way = {ploc_join, 1, 4};
    struct primitive_ref *refs = test_refs_make(REFS_SAME, COUNT, 1);
    memory_init(&memory, UINT64_MAX);
    for (uint32_t i = 0; i < COUNT; i++)
        for (int axis = 0; axis < 3; axis++)
            refs[i].min[axis] = refs[i].max[axis] = axis ? 0 : (float)i * (float)i;
    struct box *boxes = test_refs_boxes(refs, COUNT);
    assert_int_equal(run(refs, COUNT, &way, NULL, &memory, &ir, NULL), BVHD_OK);
    assert_int_equal(ir_check(&ir, COUNT, boxes, false, &memory, NULL), BVHD_OK);
    assert_true(ir_depth(&ir, &memory) < 200);
    ir_finish(&ir);
    free(boxes);
    free(refs);
    assert_int_equal(memory.live, 0);
}

/* Refs that are runs of one, two and three primitives alternately. */
static void runs_stay_together(void **state)
{
    (void)state;
    enum { COUNT = 3000, PRIMITIVES = 6 * (COUNT / 3) };
    static const struct way those[] = {{ploc_join, 3, 4}, {binned_join, 3, 0.8f}, {binned_join, 4, 2}};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (size_t w = 0; w < sizeof those / sizeof *those; w++) {
        struct ir ir;
        struct box boxes[PRIMITIVES];
        uint32_t runs[PRIMITIVES], id = 0, at[PRIMITIVES];
        struct primitive_ref *refs = test_refs_make(REFS_CLUSTERS, COUNT, 5);
        for (uint32_t i = 0; i < COUNT; i++) {
            refs[i].link = i % 3;
            refs[i].id = id;
            for (uint32_t k = 0; k <= i % 3; k++, id++) {
                boxes[id] = primitive_ref_box(&refs[i]);
                runs[id] = i;
            }
        }
        assert_int_equal(id, PRIMITIVES);
        assert_int_equal(run(refs, COUNT, &those[w], NULL, &memory, &ir, NULL), BVHD_OK);
        assert_int_equal(ir.ref_count, PRIMITIVES);
        assert_int_equal(ir_check(&ir, PRIMITIVES, boxes, false, &memory, NULL), BVHD_OK);
        for (uint32_t i = 0; i < ir.ref_count; i++)
            at[ir.refs[i]] = i;
        for (uint32_t i = 1; i < PRIMITIVES; i++)
            assert_true(runs[i] != runs[i - 1] || at[i] == at[i - 1] + 1);
        for (uint32_t i = 0; i < ir.node_count; i++)
            assert_true(ir.nodes[i].count <= those[w].leaf_max);
        ir_finish(&ir);
        free(refs);
    }
    assert_int_equal(memory.live, 0);
}

static double sah_of(enum test_refs_kind kind, const struct way *way)
{
    enum { COUNT = 20000 };
    struct memory memory;
    struct ir ir;
    memory_init(&memory, UINT64_MAX);
    struct primitive_ref *refs = test_refs_make(kind, COUNT, 3);
    assert_int_equal(run(refs, COUNT, way, NULL, &memory, &ir, NULL), BVHD_OK);
    double sah = ir_sah(&ir);
    ir_finish(&ir);
    free(refs);
    assert_int_equal(memory.live, 0);
    return sah;
}

static double median_sah_of(enum test_refs_kind kind)
{
    enum { COUNT = 20000 };
    struct memory memory;
    struct ir ir;
    memory_init(&memory, UINT64_MAX);
    struct primitive_ref *refs = test_refs_make(kind, COUNT, 3);
    struct box *boxes = test_refs_boxes(refs, COUNT);
    assert_int_equal(test_ir_make(boxes, COUNT, 2, &memory, &ir), BVHD_OK);
    double sah = ir_sah(&ir);
    ir_finish(&ir);
    free(refs);
    free(boxes);
    return sah;
}

/*
 * Compares with splits in the middle of the longest axis. Where the density is even, greedy merging from below leaves
 * gaps.
 */
static void quality_is_that_of_sah(void **state)
{
    (void)state;
    static const enum test_refs_kind kinds[] = {REFS_CLOUD, REFS_CLUSTERS, REFS_FLAT};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        static const struct way merged = {ploc_join, 3, 4}, divided = {binned_join, 3, 0.8f};
        double median = median_sah_of(kinds[k]);
        assert_true(sah_of(kinds[k], &divided) < 0.93 * median);
        assert_true(sah_of(kinds[k], &merged) < 1.05 * median);
        assert_true(sah_of(kinds[k], &divided) < 0.97 * sah_of(kinds[k], &merged));
    }
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    for (int w = 0; w < WAYS; w++) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        int64_t n = 0;
        for (; status == BVHD_NO_MEMORY; n++) {
            struct memory memory;
            struct bvhd_error error;
            struct ir ir;
            struct primitive_ref *refs = test_refs_make(REFS_CLOUD, 1000, 2);
            memory_init(&memory, UINT64_MAX);
            memory.fail_after = n;
            status = run(refs, 1000, &ways[w], NULL, &memory, &ir, &error);
            if (status == BVHD_OK)
                ir_finish(&ir);
            else
                assert_int_equal(error.status, BVHD_NO_MEMORY);
            assert_int_equal(memory.live, 0);
            free(refs);
        }
        assert_int_equal(status, BVHD_OK);
        assert_true(n > 4);
    }
}

static void cancelling_ends_it(void **state)
{
    (void)state;
    struct memory memory;
    struct bvhd_error error;
    struct ir ir;
    atomic_bool cancel = true;
    memory_init(&memory, UINT64_MAX);
    for (int w = 0; w < WAYS; w++) {
        struct primitive_ref *refs = test_refs_make(REFS_CLOUD, 1000, 2);
        assert_int_equal(run(refs, 1000, &ways[w], &cancel, &memory, &ir, &error), BVHD_CANCELLED);
        assert_int_equal(error.status, BVHD_CANCELLED);
        assert_int_equal(memory.live, 0);
        free(refs);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_gives_a_sound_tree),     cmocka_unit_test(runs_stay_together),
        cmocka_unit_test(a_row_without_pairs_ends_soon),     cmocka_unit_test(quality_is_that_of_sah),
        cmocka_unit_test(failing_allocations_leave_nothing), cmocka_unit_test(cancelling_ends_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
