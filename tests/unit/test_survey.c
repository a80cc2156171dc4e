/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <math.h>

#include "survey.h"
#include "test_world.h"

static struct survey take(struct test_world *world, int index)
{
    struct survey survey;
    assert_int_equal(survey_take(&world->structures.files[index].structure.view.portable, world->structures.files[index].size,
                                 &world->local.memory, &survey, NULL),
                     BVHD_OK);
    return survey;
}

/* Every byte, child, record and node is counted once. */
static void test_sums(void **state)
{
    (void)state;
    struct test_world world;
    test_world_init(&world, 1);
    for (int i = 0; i < TEST_WORLD_FILES; i++) {
        const struct portable_header *header = world.structures.files[i].structure.view.portable.header;
        struct survey survey = take(&world, i);
        assert_int_equal(survey.header_bytes + survey.node_bytes + survey.record_bytes + survey.vertex_bytes + survey.geometry_bytes +
                             survey.other_bytes,
                         world.structures.files[i].size);
        assert_true(survey.other_bytes < 64);
        uint64_t nodes = 0, children = 0, records = 0, on_levels = 0;
        for (unsigned k = 0; k <= 8; k++) {
            nodes += survey.node_children[k];
            children += k * survey.node_children[k];
        }
        for (unsigned k = 0; k <= PORTABLE_LEAF_MAX; k++)
            records += k * survey.leaf_records[k];
        for (unsigned k = 0; k < header->depth; k++)
            on_levels += survey.level_nodes[k];
        assert_int_equal(nodes, header->node_count);
        assert_int_equal(on_levels, header->node_count);
        assert_int_equal(children, survey.inner_children + survey.leaf_children);
        assert_int_equal(survey.inner_children, header->node_count - 1);
        assert_int_equal(records, header->record_count);
        assert_true(survey.sah > 1 && survey.sah < 1 + 2.0 * header->record_count);
    }
    test_world_finish(&world);
}

/* One node with two leaf children of known boxes: half areas by hand. */
static void test_sah(void **state)
{
    (void)state;
    struct portable_node node = {.exponent = {127, 127, 127}, .meta = {0x20, 0x60}};
    for (int axis = 0; axis < 3; axis++) {
        node.hi[axis][0] = 1;
        node.hi[axis][1] = 2;
    }
    const struct portable_header header = {.content = PORTABLE_AABBS,
                                           .bounds = {0, 0, 0, 2, 2, 2},
                                           .depth = 1,
                                           .node_count = 1,
                                           .record_count = 3,
                                           .body_size = 128 + 80 + 96};
    struct portable_view view = {.header = &header, .nodes = &node};
    struct memory memory;
    struct survey survey;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(survey_take(&view, 64 + 128 + 80 + 96, &memory, &survey, NULL), BVHD_OK);
    assert_true(fabs(survey.sah - (1 + (3.0 * 1 + 12.0 * 2) / 12)) < 1e-12);
    assert_int_equal(survey.header_bytes, 64 + 128);
    assert_int_equal(survey.other_bytes, 0);
    atomic_store(&memory.fail_after, 0);
    assert_int_equal(survey_take(&view, 64 + 128 + 80 + 96, &memory, &survey, NULL), BVHD_NO_MEMORY);
    assert_int_equal(memory.live, 0);
}

static void test_names(void **state)
{
    (void)state;
    assert_string_equal(survey_content_name(PORTABLE_INSTANCES), "instances");
    assert_string_equal(survey_content_name(99), "unknown");
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_sums), cmocka_unit_test(test_sah), cmocka_unit_test(test_names)};
    return cmocka_run_group_tests_name("survey", tests, NULL, NULL);
}
