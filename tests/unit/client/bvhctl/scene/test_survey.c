/* SPDX-License-Identifier: Apache-2.0 */
/* test_survey.c - tests the figures about a structure. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/scene/survey.h"
#include "tests/support/client/bvhctl/test_world.h"

static struct survey take(struct test_world *world, int index)
{
    struct survey survey;
    assert_int_equal(survey_take(&world->structures.files[index].structure, &world->local.memory, &survey, NULL),
                     BVHD_OK);
    return survey;
}

static void check_sums(const struct structure *structure, const struct survey *survey, uint64_t most_padding)
{
    assert_int_equal(survey->header_bytes + survey->node_bytes + survey->record_bytes + survey->vertex_bytes +
                         survey->geometry_bytes + survey->other_bytes,
                     structure->blob.size);
    assert_true(survey->other_bytes < most_padding);
    uint64_t nodes = 0, children = 0, records = 0, on_levels = 0;
    for (unsigned k = 0; k <= 8; k++) {
        nodes += survey->node_children[k];
        children += k * survey->node_children[k];
    }
    for (unsigned k = 0; k <= PORTABLE_LEAF_MAX; k++)
        records += k * survey->leaf_records[k];
    for (unsigned k = 0; k < survey->depth; k++)
        on_levels += survey->level_nodes[k];
    assert_int_equal(nodes, survey->nodes);
    assert_int_equal(on_levels, survey->nodes);
    assert_int_equal(children, survey->inner_children + survey->leaf_children);
    assert_int_equal(survey->inner_children, survey->nodes - 1);
    assert_int_equal(records, structure->record_count);
    assert_true(survey->sah > 1 && survey->sah < 1 + 2.0 * structure->record_count);
}

/* Every byte, child, record and node is counted once. */
static void test_sums(void **state)
{
    (void)state;
    struct test_world world;
    test_world_init(&world, 1);
    for (int i = 0; i < TEST_WORLD_FILES; i++) {
        const struct structure *structure = &world.structures.files[i].structure;
        struct survey survey = take(&world, i);
        check_sums(structure, &survey, 64);
        assert_int_equal(survey.arity, 8);
        assert_int_equal(survey.nodes, structure->view.portable.header->node_count);
        assert_int_equal(survey.depth, structure->view.portable.header->depth);
        assert_int_equal(survey.unused_nodes + survey.unreferred_records, 0);
    }
    test_world_finish(&world);
}

/* The same for native structures. One of four instances is inactive, which leaves room for a leaf. */
static void test_native_sums(void **state)
{
    (void)state;
    for (uint32_t variant = 1; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct bvhd_format format = {.struct_size = sizeof format, .target = BVHD_TARGET_LAVAPIPE, .variant = variant};
        struct test_world world;
        test_world_init_for(&world, 1, &format);
        for (int i = 0; i < TEST_WORLD_FILES; i++) {
            const struct structure *structure = &world.structures.files[i].structure;
            const struct lavapipe_view *view = &structure->view.lavapipe;
            struct survey survey = take(&world, i);
            check_sums(structure, &survey, i == 2 ? 64 + sizeof(struct lavapipe_instance) : 64);
            assert_int_equal(survey.arity, 2);
            assert_int_equal(survey.depth, view->levels);
            assert_int_equal(survey.nodes + survey.unused_nodes,
                             (view->leaf_offset - LAVAPIPE_HEADER) / sizeof(struct lavapipe_box));
            assert_true(fabs(survey.sah - world.assembly.items[i].sah) < 1e-3 * survey.sah);
        }
        struct survey top = take(&world, 2);
        assert_int_equal(top.nodes, 2);
        assert_int_equal(top.leaf_children, 3);
        test_world_finish(&world);
        assert_int_equal(world.local.memory.live, 0);
    }
}

/* The SAH of one node with two leaf children is that of half areas computed by hand. */
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
    struct structure structure = {.blob.size = 64 + 128 + 80 + 96,
                                  .target = TARGET_PORTABLE,
                                  .view.portable = {.header = &header, .nodes = &node}};
    struct memory memory;
    struct survey survey;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(survey_take(&structure, &memory, &survey, NULL), BVHD_OK);
    assert_true(fabs(survey.sah - (1 + (3.0 * 1 + 12.0 * 2) / 12)) < 1e-12);
    assert_int_equal(survey.header_bytes, 64 + 128);
    assert_int_equal(survey.other_bytes, 0);
    atomic_store(&memory.fail_after, 0);
    assert_int_equal(survey_take(&structure, &memory, &survey, NULL), BVHD_NO_MEMORY);
    assert_int_equal(memory.live, 0);
}

static void test_names(void **state)
{
    (void)state;
    const struct portable_header header = {.content = PORTABLE_INSTANCES};
    struct structure portable = {.target = TARGET_PORTABLE, .view.portable.header = &header};
    struct structure native = {.target = TARGET_LAVAPIPE, .content = CONTENT_AABBS},
                     nothing = {.target = TARGET_LAVAPIPE};
    assert_string_equal(survey_content_name(&portable), "instances");
    assert_string_equal(survey_content_name(&native), "AABBs");
    assert_string_equal(survey_content_name(&nothing), "nothing");
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_sums), cmocka_unit_test(test_native_sums),
                                       cmocka_unit_test(test_sah), cmocka_unit_test(test_names)};
    return cmocka_run_group_tests_name("survey", tests, NULL, NULL);
}
