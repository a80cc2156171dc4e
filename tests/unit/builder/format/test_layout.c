/* SPDX-License-Identifier: Apache-2.0 */
/* test_layout.c - tests that targets and names lead to their layouts, and that the layouts' limits are sensible. */
#include "tests/support/unit.h"

#include "builder/format/layout.h"
#include "proto/base/kind.h"

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
    assert_true(layout->arity == 2 || layout->arity == WIDE_ARITY);
    assert_in_range(layout->leaf_max, 1, 3);
    assert_in_range(layout->depth_limit, 30, 1000); /* 2^29 primitives need 30 levels of a binary tree */
    assert_int_equal(layout->flags, PORTABLE_FAST_TRIANGLES);
}

/* Versions of structures with old kinds stay, because they are part of keys. */
static void versions_tell_the_kinds(void **state)
{
    static const struct {
        uint32_t type, portable, lavapipe;
    } rows[] = {
        {GEOMETRY_TRIANGLES, 1, 1},        {GEOMETRY_AABBS, 1, 1},         {GEOMETRY_INSTANCES, 1, 1},
        {GEOMETRY_SPHERES, 2, 0},          {GEOMETRY_SWEPT_SPHERES, 2, 0}, {GEOMETRY_MOVING_TRIANGLES, 2, 0},
        {GEOMETRY_MOVING_INSTANCES, 2, 0},
    };
    (void)state;
    assert_int_equal(sizeof rows / sizeof *rows, KIND_OF_RAYS);
    for (int i = 0; i < KIND_OF_RAYS; i++) {
        struct canonical_geometry row = {.type = rows[i].type};
        const struct geometry geometry = {.type = rows[i].type};
        const struct canonical canonical = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &row};
        struct bvhd_error error = {.status = BVHD_OK};
        const struct validate_subject subject = {&geometry, 3, 4, &error, false};
        assert_int_equal(layout_portable.version(rows[i].type), rows[i].portable);
        assert_int_equal(layout_version(&layout_portable, &canonical), rows[i].portable);
        assert_int_equal(layout_version(&layout_lavapipe, &canonical), rows[i].lavapipe);
        assert_int_equal(layout_check_kind(&layout_portable, &subject), BVHD_OK);
        assert_int_equal(layout_check_kind(&layout_lavapipe, &subject), rows[i].lavapipe ? BVHD_OK : BVHD_UNSUPPORTED);
        if (rows[i].lavapipe)
            continue;
        assert_string_equal(error.where, "infos[3].geometries[4].geometryType");
        assert_non_null(strstr(error.text, kind_find(rows[i].type)->noun));
    }
    const struct canonical none = {.type = STRUCTURE_BOTTOM}, top = {.type = STRUCTURE_TOP};
    assert_int_equal(layout_version(&layout_portable, &none), 1);
    assert_int_equal(layout_version(&layout_portable, &top), 1);
    /* One geometry that moves decides for all. */
    struct canonical_geometry mixed_rows[] = {{.type = GEOMETRY_TRIANGLES}, {.type = GEOMETRY_MOVING_TRIANGLES}};
    const struct canonical mixed = {.type = STRUCTURE_BOTTOM, .geometry_count = 2, .geometries = mixed_rows};
    assert_int_equal(canonical_kind(&mixed), GEOMETRY_MOVING_TRIANGLES);
    assert_int_equal(layout_version(&layout_portable, &mixed), 2);
    assert_int_equal(layout_version(&layout_lavapipe, &mixed), 0);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(targets_lead_to_their_layout),
        cmocka_unit_test(unknown_targets_lead_nowhere),
        cmocka_unit_test(a_layout_states_what_can_be_done),
        cmocka_unit_test(versions_tell_the_kinds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
