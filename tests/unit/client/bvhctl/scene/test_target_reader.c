/* SPDX-License-Identifier: Apache-2.0 */
/* test_target_reader.c - tests that every row of the table of readers reads what the layout of its target writes. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/layout.h"
#include "builder/format/serialized.h"
#include "client/bvhctl/scene/survey.h"
#include "client/bvhctl/scene/target_reader.h"
#include "tests/support/client/bvhctl/test_world.h"

enum { TARGETS_TRIED = 100 };

/* Every target that can be built can be read, and the other way round. */
static void test_rows(void **state)
{
    (void)state;
    int found = 0;
    for (int target = 0; target < TARGETS_TRIED; target++) {
        const struct target_reader *reader = target_reader_find((enum target)target);
        const struct layout *layout = layout_find((enum target)target);
        assert_int_equal(reader != NULL, layout != NULL);
        if (!reader)
            continue;
        assert_int_equal(reader->target, target);
        assert_int_equal(reader->is_native, layout->variants > 0);
        assert_int_equal(reader->driver_uuid != NULL, !reader->is_native);
        found++;
    }
    assert_int_equal(found, TARGET_READER_COUNT);
}

static void check_triangles(const struct structure *bottom, const struct import_mesh *mesh)
{
    assert_int_equal(bottom->content, CONTENT_TRIANGLES);
    assert_int_equal(structure_triangle_count(bottom), mesh->primitive_count);
    assert_int_equal(structure_instance_count(bottom), 0);
    for (uint32_t row = 0; row < structure_triangle_count(bottom); row++) {
        float corners[3][3];
        uint32_t primitive;
        structure_triangle(bottom, row, 0, corners, &primitive);
        assert_in_range(primitive, 0, mesh->primitive_count - 1);
        for (int i = 0; i < 3; i++)
            assert_memory_equal(corners[i], mesh->positions + 3 * mesh->indices[3 * primitive + (unsigned)i],
                                sizeof corners[i]);
    }
}

static void check_instances(const struct structure *top, const struct import *import)
{
    assert_int_equal(top->content, CONTENT_INSTANCES);
    assert_int_equal(structure_instance_count(top), TEST_WORLD_INSTANCES - 1);
    assert_int_equal(structure_triangle_count(top), 0);
    for (uint32_t row = 0; row < structure_instance_count(top); row++) {
        struct structure_instance instance = structure_instance(top, row);
        assert_in_range(instance.instance, 0, TEST_WORLD_INSTANCES - 1);
        const struct import_instance *source = &import->instances[instance.instance];
        assert_false(source->skipped);
        assert_int_equal(instance.bottom, source->bottom);
        assert_memory_equal(instance.start, source->transform, sizeof source->transform);
    }
}

static void check_survey(const struct structure *structure, struct memory *memory)
{
    struct survey survey;
    float bounds[6];
    structure_bounds(structure, bounds);
    for (int axis = 0; axis < 3; axis++)
        assert_true(bounds[axis] >= -9 && bounds[axis] <= bounds[3 + axis] && bounds[3 + axis] <= 9);
    assert_int_equal(survey_take(structure, memory, &survey, NULL), BVHD_OK);
    assert_true(survey.nodes > 0 && survey.depth > 0 && survey.sah > 1);
    assert_in_range(survey.arity, 2, 8);
    assert_in_range(survey.leaf_max, 1, PORTABLE_LEAF_MAX);
    assert_in_range(survey.figure_count, 1, SURVEY_FIGURES);
    assert_int_equal(survey.records - survey.unreferred_records, structure->record_count);
    for (uint32_t i = 0; i < survey.figure_count; i++)
        assert_int_equal(*survey_find_figure(&survey, survey.figures[i].name), survey.figures[i].value);
    assert_null(survey_find_figure(&survey, "no such figure"));
    assert_string_equal(survey_content_name(structure) + strlen(survey_content_name(structure)) - 1, "s");
}

/* A ray from above meets the cube on the ground. */
static void check_trace(const struct structures *structures)
{
    struct ray ray = {.origin = {0.25f, 9, 0.5f}, .direction = {0, -1, 0}, .tmax = INFINITY, .cull_mask = 0xff};
    struct ray_hit hit;
    float corners[3][3];
    assert_true(structures_trace(structures, &ray, &hit));
    assert_true(hit.t == 7 && hit.instance == 1 && hit.handle == 1);
    structures_corners(structures, &hit, 0, corners);
    for (int i = 0; i < 3; i++)
        assert_true(corners[i][1] == 1);
}

static void check_handles(const struct target_reader *reader, const struct structure *top)
{
    struct serialized_header header;
    assert_int_equal(serialized_read(top->blob, &header, NULL), BVHD_OK);
    assert_int_equal(header.handle_count, reader->has_handle_per_row ? 2 : TEST_WORLD_INSTANCES - 1);
    if (reader->driver_uuid)
        assert_memory_equal(header.driver_uuid, reader->driver_uuid, sizeof header.driver_uuid);
}

static void check_world(const struct target_reader *reader, struct test_world *world)
{
    const struct structures *structures = &world->structures;
    assert_int_equal(structures->target, reader->target);
    for (int i = 0; i < TEST_WORLD_FILES; i++) {
        assert_int_equal(structures->files[i].structure.target, reader->target);
        check_survey(&structures->files[i].structure, &world->local.memory);
    }
    for (uint32_t bottom = 0; bottom < 2; bottom++)
        check_triangles(&structures->files[bottom].structure, &world->import.meshes[bottom]);
    check_instances(structures_top(structures), &world->import);
    check_handles(reader, structures_top(structures));
    check_trace(structures);
}

/* Every function of every row, over a scene that was built for its target and each variant of it. */
static void test_functions(void **state)
{
    (void)state;
    for (int i = 0; i < TARGET_READER_COUNT; i++) {
        const struct target_reader *reader = target_readers[i];
        uint32_t variants = layout_find(reader->target)->variants;
        for (uint32_t variant = reader->is_native; variant <= variants; variant++) {
            struct bvhd_format format = {
                .struct_size = sizeof format, .target = (enum bvhd_target)reader->target, .variant = variant};
            struct test_world world;
            test_world_init_for(&world, 1, reader->is_native ? &format : NULL);
            check_world(reader, &world);
            structures_separate(&world.structures);
            assert_int_equal(structures_join(&world.structures, NULL), BVHD_OK);
            check_trace(&world.structures);
            test_world_finish(&world);
            assert_int_equal(world.local.memory.live, 0);
        }
    }
}

/* An inverse of a driver undoes the matrix, but for rounding. */
static void test_inverses(void **state)
{
    (void)state;
    static const float matrix[12] = {2, 0, 0, 3, 0, 0.5f, 0, -1, 0, 0, 4, 8};
    static const float expected[12] = {0.5f, 0, 0, -1.5f, 0, 2, 0, 2, 0, 0, 0.25f, -2};
    for (int i = 0; i < TARGET_READER_COUNT; i++) {
        float inverse[12];
        if (!target_readers[i]->invert)
            continue;
        target_readers[i]->invert(matrix, inverse);
        for (int k = 0; k < 12; k++)
            assert_float_equal(inverse[k], expected[k], 1e-6);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_rows), cmocka_unit_test(test_functions),
                                       cmocka_unit_test(test_inverses)};
    return cmocka_run_group_tests_name("target_reader", tests, NULL, NULL);
}
