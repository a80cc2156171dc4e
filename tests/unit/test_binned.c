/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <math.h>

#include "binned.h"
#include "test_ir.h"
#include "test_refs.h"

static enum bvhd_status run(enum test_refs_kind kind, uint32_t count, uint32_t leaf_max, struct memory *memory, struct ir *ret_ir,
                            struct box **ret_boxes)
{
    struct primitive_ref *refs = test_refs_make(kind, count, count), *scratch = test_refs_make(REFS_SAME, count, 0);
    struct binned_request request = {.refs = refs, .scratch = scratch, .count = count, .leaf_max = leaf_max};
    *ret_boxes = test_refs_boxes(refs, count);
    enum bvhd_status status = binned_build(&request, memory, ret_ir, NULL);
    free(refs);
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
            for (uint32_t leaf = 1; leaf <= 4; leaf++) {
                struct ir ir;
                struct box *boxes;
                assert_int_equal(run((enum test_refs_kind)kind, count, leaf, &memory, &ir, &boxes), BVHD_OK);
                assert_int_equal(ir_check(&ir, count, boxes, false, &memory, NULL), BVHD_OK);
                for (uint32_t i = 0; i < ir.node_count; i++)
                    assert_true(ir.nodes[i].count <= leaf);
                if (kind == REFS_SAME)
                    assert_true(ir_depth(&ir, &memory) <= 1 + ceil(log2(count)));
                ir_finish(&ir);
                free(boxes);
            }
    assert_int_equal(memory.live, 0);
}

/* Better than splits in the middle of the longest axis. */
static void quality_is_that_of_sah(void **state)
{
    (void)state;
    struct memory memory;
    struct ir ir, median;
    struct box *boxes;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(run(REFS_CLUSTERS, 20000, 2, &memory, &ir, &boxes), BVHD_OK);
    assert_int_equal(test_ir_make(boxes, 20000, 2, &memory, &median), BVHD_OK);
    assert_true(ir_sah(&ir) < 0.95 * ir_sah(&median));
    ir_finish(&ir);
    ir_finish(&median);
    free(boxes);
    assert_int_equal(memory.live, 0);
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    struct memory memory;
    struct ir ir;
    struct box *boxes;
    memory_init(&memory, UINT64_MAX);
    for (int64_t n = 0; n < 3; n++) {
        memory.fail_after = n;
        assert_int_equal(run(REFS_CLOUD, 100, 2, &memory, &ir, &boxes), BVHD_NO_MEMORY);
        assert_int_equal(memory.live, 0);
        free(boxes);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_gives_a_sound_tree),
        cmocka_unit_test(quality_is_that_of_sah),
        cmocka_unit_test(failing_allocations_leave_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
