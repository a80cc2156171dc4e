/* SPDX-License-Identifier: Apache-2.0 */
/* test_crossing.c - tests what is found to cross, by refs in blocks and in one row, by runs and by single refs. */
#include "tests/support/unit.h"

#include "builder/kernel/leaves.h"
#include "builder/top/crossing.h"
#include "tests/support/builder/test_flocks.h"

static struct flocks flocks;
static struct memory memory;

/* Returns whether the triangles cross, whatever form the refs have. */
static bool crosses(bool are_runs)
{
    const struct leaves_options runs = {3, 0.85f};
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    struct primitive_refs refs;
    bool found[2];
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(primitive_collect_blocks(&flocks.canonical, are_runs ? &runs : NULL, &context, &refs, NULL),
                     BVHD_OK);
    assert_int_equal(crossing_find(&flocks.canonical, &refs, &memory, &found[0]), BVHD_OK);
    assert_true(primitive_close_gaps(&refs, &context));
    assert_int_equal(crossing_find(&flocks.canonical, &refs, &memory, &found[1]), BVHD_OK);
    assert_int_equal(found[0], found[1]);
    memory_free(&memory, refs.refs);
    assert_int_equal(memory.live, 0);
    return found[0];
}

static void what_crosses_is_found(void **state)
{
    (void)state;
    static const bool expected[FLOCKS_SHAPES] = {[FLOCKS_CROSS] = true, [FLOCKS_RANDOM] = true};
    static const uint32_t counts[] = {300, 5000, FLOCKS_COUNT};
    for (int i = 0; i < 3; i++)
        for (enum flocks_shape shape = FLOCKS_SMOOTH; shape < FLOCKS_SHAPES; shape++)
            for (int runs = 0; runs < 2; runs++) {
                flocks_make(&flocks, shape, counts[i], 1);
                if (shape == FLOCKS_LANES || (shape == FLOCKS_RANDOM && counts[i] < 5000))
                    continue; /* these are near the limit: boxes of all times part many of them, too */
                if (crosses(runs) != expected[shape])
                    fail_msg("shape %d of %u triangles", (int)shape, counts[i]);
            }
}

/* Few primitives do not cross, nor do those that stand still, or have no boxes. */
static void the_rest_does_not_cross(void **state)
{
    (void)state;
    flocks_make(&flocks, FLOCKS_CROSS, 20, 1);
    assert_false(crosses(false));
    flocks_make(&flocks, FLOCKS_CROSS, 5000, 1);
    flocks.geometry.type = GEOMETRY_TRIANGLES;
    flocks.geometry.end_positions = NULL;
    assert_false(crosses(false));
    flocks_make(&flocks, FLOCKS_CROSS, 5000, 1);
    for (uint32_t i = 0; i < 5000; i++)
        flocks.start[i][0][0] = NAN;
    assert_false(crosses(false));
}

static void memory_may_be_missing(void **state)
{
    (void)state;
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    struct primitive_refs refs;
    bool found;
    flocks_make(&flocks, FLOCKS_CROSS, 5000, 1);
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(primitive_collect_blocks(&flocks.canonical, NULL, &context, &refs, NULL), BVHD_OK);
    memory.fail_after = 0;
    assert_int_equal(crossing_find(&flocks.canonical, &refs, &memory, &found), BVHD_NO_MEMORY);
    memory_free(&memory, refs.refs);
    memory_free(&memory, refs.blocks);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_crosses_is_found),
        cmocka_unit_test(the_rest_does_not_cross),
        cmocka_unit_test(memory_may_be_missing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
