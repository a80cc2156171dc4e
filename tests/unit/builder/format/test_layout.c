/* SPDX-License-Identifier: Apache-2.0 */
/* test_layout.c - tests that targets and names lead to their layouts, and that the layouts' limits are sensible. */
#include "tests/support/unit.h"

#include "builder/format/layout.h"

static void targets_lead_to_their_layout(void **state)
{
    (void)state;
    const struct layout *layout = layout_find(TARGET_PORTABLE);
    assert_non_null(layout);
    assert_int_equal(layout->target, TARGET_PORTABLE);
    assert_ptr_equal(layout, &layout_portable);
    assert_string_equal(layout->name, "portable");
    assert_ptr_equal(layout_find_name("portable"), layout);
}

static void unknown_targets_lead_nowhere(void **state)
{
    (void)state;
    assert_null(layout_find((enum target)0));
    assert_null(layout_find((enum target)3));
    assert_null(layout_find((enum target) - 1));
    assert_null(layout_find_name(""));
    assert_null(layout_find_name("Portable"));
    assert_null(layout_find_name("portable "));
}

/* The properties that the builder relies on when it makes a tree for a layout. */
static void a_layout_states_what_can_be_done(void **state)
{
    (void)state;
    const struct layout *layout = layout_find(TARGET_PORTABLE);
    assert_non_null(layout->write);
    assert_true(layout->version >= 1);
    assert_true(layout->arity == 2 || layout->arity == WIDE_ARITY);
    assert_in_range(layout->leaf_max, 1, 3);
    assert_in_range(layout->depth_limit, 30, 1000); /* 2^29 primitives need 30 levels of a binary tree */
    assert_int_equal(layout->flags, PORTABLE_FAST_TRIANGLES);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(targets_lead_to_their_layout),
        cmocka_unit_test(unknown_targets_lead_nowhere),
        cmocka_unit_test(a_layout_states_what_can_be_done),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
