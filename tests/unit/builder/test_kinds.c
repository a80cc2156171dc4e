/* SPDX-License-Identifier: Apache-2.0 */
/* test_kinds.c - tests that no table of the builder lacks a kind of geometry, or a function that all kinds need. */
#include "tests/support/unit.h"

#include "builder/format/record_kind.h"
#include "builder/input/input_kind.h"
#include "builder/traverse/leaf_kind.h"
#include "builder/update/update_kind.h"
#include "proto/base/kind.h"

static const uint32_t types[KIND_OF_RAYS] = {
    GEOMETRY_TRIANGLES,        GEOMETRY_AABBS,           GEOMETRY_INSTANCES, GEOMETRY_SPHERES, GEOMETRY_SWEPT_SPHERES,
    GEOMETRY_MOVING_TRIANGLES, GEOMETRY_MOVING_INSTANCES};
/* Types without a kind. */
static const uint32_t foreign[] = {3, 1000429003, 1000478000, UINT32_MAX};

static void all_kinds_are_tested(void **state)
{
    (void)state;
    for (int i = 0; i < KIND_OF_RAYS; i++) {
        assert_non_null(kind_find(types[i]));
        assert_int_equal(kind_find(types[i])->number, i);
        assert_true(kind_find(types[i])->primitive_bytes > 0);
    }
}

static void input_is_complete(void **state)
{
    (void)state;
    for (int i = 0; i < KIND_OF_RAYS; i++) {
        const struct input_kind *kind = input_kind_of(types[i]);
        assert_non_null(kind);
        assert_true((kind->corners > 0) == (kind_find(types[i])->vertex_bytes > 0));
        assert_true(kind->check_memory && kind->view && kind->fetch_primitives && kind->check_foreign);
        assert_true(kind->look && kind->collect);
        assert_true((kind->corners > 0) == (kind->fetch_vertices && kind->rebase && kind->finish && kind->describe));
        assert_int_equal(kind_find(types[i])->is_top, !kind->outline);
        assert_int_equal(kind_find(types[i])->moves, kind->look_at_keys != NULL);
    }
    for (size_t i = 0; i < sizeof foreign / sizeof *foreign; i++)
        assert_null(input_kind_of(foreign[i]));
}

static void update_is_complete(void **state)
{
    (void)state;
    for (int i = 0; i < KIND_OF_RAYS; i++) {
        const struct update_kind *kind = update_kind_of(types[i]);
        assert_non_null(kind);
        assert_true(kind->version > 0 && kind->version <= RECORD_NEWEST);
        assert_true(kind->row_is_sound && kind->active && kind->write);
        assert_int_equal(kind_find(types[i])->moves, kind->key_boxes != NULL);
        assert_int_equal(kind_find(types[i])->moves, kind->boxes == NULL);
        assert_true((kind->rule_count > 0) == (kind->rules != NULL));
        assert_true((input_kind_of(types[i])->corners > 0) == (kind->has_nan != NULL));
    }
    for (size_t i = 0; i < sizeof foreign / sizeof *foreign; i++)
        assert_null(update_kind_of(foreign[i]));
}

/* The contents of a structure lead to the kind of its geometries, and back. */
static void contents_are_complete(void **state)
{
    (void)state;
    for (uint32_t content = 0; content < PORTABLE_CONTENTS; content++) {
        const struct record_kind *record = record_kind_of(content);
        const struct leaf_kind *leaf = leaf_kinds[content];
        assert_true(record && record->size > 0 && record->first_leaf > 0 && record->write && record->find_unsound);
        assert_true((record->vertex_size > 0) == (record->vertices_most != NULL));
        assert_true(leaf && leaf->visit && leaf->is_top == (leaf->skip_flag == 0));
        const struct kind *kind = kind_find(record->type);
        assert_non_null(kind);
        assert_true(kind->is_top == leaf->is_top && kind->is_top == record_kind_is_top(content));
        assert_int_equal(
            record_content_for(kind->is_top ? STRUCTURE_TOP : STRUCTURE_BOTTOM, record->type, record->layout_flag),
            content);
    }
    assert_null(record_kind_of(PORTABLE_CONTENTS));
    assert_false(record_kind_is_top(UINT32_MAX));
    /* Nothing but the type of the structure makes a top level, and flags choose among contents of one type. */
    assert_int_equal(record_content_for(STRUCTURE_TOP, GEOMETRY_TRIANGLES, PORTABLE_FAST_TRIANGLES),
                     PORTABLE_INSTANCES);
    assert_int_equal(record_content_for(STRUCTURE_BOTTOM, GEOMETRY_AABBS, PORTABLE_FAST_TRIANGLES), PORTABLE_AABBS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_kinds_are_tested),
        cmocka_unit_test(input_is_complete),
        cmocka_unit_test(update_is_complete),
        cmocka_unit_test(contents_are_complete),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
