/* SPDX-License-Identifier: Apache-2.0 */
/* test_rescale.c - tests that only extreme scenes are rescaled, and exactly. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/rescale.h"
#include "tests/support/builder/test_refs.h"

static const struct build_context serial = {.parallel = &parallel_serial};

static void only_extremes_need_it(void **state)
{
    (void)state;
    static const struct {
        float least, most;
        bool needed;
    } cases[] = {
        {0, 0, false},         {-1, 1, false},       {0, 0x1p40f, false},   {0, 0x1.1p40f, true},
        {-0x1.1p40f, 1, true}, {-FLT_MAX, 1, true},  {0, 1e-6f, false},     {0, 0x1p-20f, false},
        {0, 0x1p-21f, true},   {-0x1p-21f, 0, true}, {-0x1p-149f, 0, true},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (int axis = 0; axis < 3; axis++) {
            struct box box = {{0, 0, 0}, {0, 0, 0}};
            box.min[axis] = cases[i].least;
            box.max[axis] = cases[i].most;
            assert_int_equal(rescale_is_needed(&box), cases[i].needed);
        }
    struct box empty = box_empty();
    assert_false(rescale_is_needed(&empty));
}

/* Refs are scaled exactly by a power of two when nothing becomes too small for a float. */
static void refs_are_scaled_exactly(void **state)
{
    (void)state;
    static const int exponents[] = {-120, -30, 0, 60, 120};
    for (size_t e = 0; e < sizeof exponents / sizeof *exponents; e++) {
        enum { COUNT = 40000 };
        struct primitive_refs refs = {.refs = test_refs_make(REFS_CLOUD, COUNT, 1), .count = COUNT};
        for (uint32_t i = 0; i < COUNT; i++)
            for (int axis = 0; axis < 3; axis++) {
                refs.refs[i].min[axis] = ldexpf(refs.refs[i].min[axis], exponents[e]);
                refs.refs[i].max[axis] = ldexpf(refs.refs[i].max[axis], exponents[e]);
            }
        struct primitive_ref *before = malloc(COUNT * sizeof *before);
        assert_non_null(before);
        memcpy(before, refs.refs, COUNT * sizeof *before);
        primitive_ref_bounds(refs.refs, COUNT, &refs.bounds, &refs.centroids);
        assert_true(rescale_refs(&refs, &serial));
        float largest = 0, factor = refs.refs[0].min[0] / before[0].min[0];
        for (uint32_t i = 0; i < COUNT; i++)
            for (int axis = 0; axis < 3; axis++) {
                assert_true(refs.refs[i].min[axis] == before[i].min[axis] * factor);
                assert_true(refs.refs[i].max[axis] == before[i].max[axis] * factor);
                largest = fmaxf(largest, fmaxf(fabsf(refs.refs[i].min[axis]), fabsf(refs.refs[i].max[axis])));
                assert_true(refs.refs[i].min[axis] >= refs.bounds.min[axis] &&
                            refs.refs[i].max[axis] <= refs.bounds.max[axis]);
            }
        assert_true(largest >= 1 && largest < 2);
        free(before);
        free(refs.refs);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(only_extremes_need_it),
        cmocka_unit_test(refs_are_scaled_exactly),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
