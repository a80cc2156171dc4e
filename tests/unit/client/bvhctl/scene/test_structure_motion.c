/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_structure_motion.c - tests what is read of structures that move, at any time, and what the oracle gets of them.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/oracle/oracle_moment.h"
#include "client/bvhctl/scene/survey.h"
#include "client/bvhctl/scene/unpack.h"
#include "tests/support/client/bvhctl/moving_world.h"

enum { SHEET = 0, TOP = MOVING_WORLD_BOTTOMS };

static const float times[] = {0, 0.25f, 0.7f, 1};

enum { TIMES = sizeof times / sizeof *times };

static const struct structure *structure_of(const struct moving_world *world, int index)
{
    return &world->structures.files[index].structure;
}

/* The definition of what moves: each operation is rounded to a float. */
static float at_time(float start, float end, float time)
{
    const float rest = 1 - time, before = start * rest, after = end * time;
    return before + after;
}

static void contents_are_told(void **state)
{
    (void)state;
    static const char *const names[] = {"motion triangles", "triangles", "spheres", "motion instances"};
    static struct moving_world world;
    moving_world_init(&world, 1);
    for (int i = 0; i <= TOP; i++) {
        const char *name = survey_content_name(structure_of(&world, i));
        assert_string_equal(strncmp(name, "indexed ", 8) ? name : name + 8, names[i]);
        assert_int_equal(structure_of(&world, i)->moves, i == SHEET || i == TOP);
    }
    moving_world_finish(&world);
    assert_int_equal(world.local.memory.live, 0);
}

static void triangles_are_where_they_are_at_a_time(void **state)
{
    (void)state;
    static struct moving_world world;
    moving_world_init(&world, 1);
    const struct structure *sheet = structure_of(&world, SHEET);
    assert_int_equal(sheet->content, CONTENT_TRIANGLES);
    assert_int_equal(structure_triangle_count(sheet), MOVING_WORLD_TRIANGLES);
    for (uint32_t row = 0; row < MOVING_WORLD_TRIANGLES; row++)
        for (int k = 0; k < TIMES; k++) {
            float corners[3][3];
            uint32_t primitive;
            structure_triangle(sheet, row, times[k], corners, &primitive);
            assert_in_range(primitive, 0, MOVING_WORLD_TRIANGLES - 1);
            for (uint32_t i = 0; i < 9; i++) {
                uint32_t at = 3 * world.sheet.indices[3 * primitive + i / 3] + i % 3;
                assert_true(corners[i / 3][i % 3] == at_time(world.sheet.start[at], world.sheet.end[at], times[k]));
            }
        }
    moving_world_finish(&world);
}

/* The matrices of the middle of the motion, by hand: the second cube has turned by 40 degrees about y. */
static void instances_are_where_they_are_at_a_time(void **state)
{
    (void)state;
    static const float middles[MOVING_WORLD_INSTANCES][12] = {
        {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
        {1, 0, 0, 0, 0, 1, 0, 4, 0, 0, 1, -4},
        {0.76604444f, 0, 0.64278761f, 0, 0, 1, 0, 4, -0.64278761f, 0, 0.76604444f, 4},
        {1, 0, 0, 5, 0, 1, 0, 4.5f, 0, 0, 1, 2}};
    static struct moving_world world;
    moving_world_init(&world, 1);
    const struct structure *top = structure_of(&world, TOP);
    uint32_t seen = 0;
    assert_int_equal(top->content, CONTENT_INSTANCES);
    assert_int_equal(structure_instance_count(top), MOVING_WORLD_INSTANCES);
    for (uint32_t row = 0; row < MOVING_WORLD_INSTANCES; row++) {
        const struct structure_instance instance = structure_instance(top, row);
        const struct moving_place *place = &moving_places[instance.instance];
        float matrix[12];
        assert_int_equal(instance.motion, place->motion);
        assert_int_equal(instance.bottom, place->bottom);
        assert_memory_equal(instance.start, place->start, sizeof instance.start);
        assert_memory_equal(instance.end, place->end, sizeof instance.end);
        structure_instance_matrix(&instance, 0.5f, matrix);
        for (int i = 0; i < 12; i++)
            assert_true(fabsf(matrix[i] - middles[instance.instance][i]) < 1e-6f);
        seen |= 1u << instance.instance;
    }
    assert_int_equal(seen, (1u << MOVING_WORLD_INSTANCES) - 1);
    moving_world_finish(&world);
}

/* A rotation that goes through zero has no matrix there, and its neighbours have one. */
static void a_rotation_may_be_nothing(void **state)
{
    (void)state;
    const struct structure_instance instance = {
        .motion = MOTION_SRT,
        .start = {1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 3, 0, 0},
        .end = {1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, -1, 3, 0, 0},
    };
    float matrix[12];
    structure_instance_matrix(&instance, 0.5f, matrix);
    for (int i = 0; i < 12; i++)
        assert_true(matrix[i] == 0);
    structure_instance_matrix(&instance, 0.25f, matrix);
    assert_true(matrix[0] == 1 && matrix[3] == 3);
}

/* Returns half the area of a child's box, each side moving in a straight line, by the mean over many times. */
static double mean_half_area(const struct portable_moving_node *node, unsigned slot)
{
    enum { STEPS = 4000 };
    double sum = 0;
    for (int i = 0; i < STEPS; i++) {
        double at = (i + 0.5) / STEPS, side[3];
        for (int axis = 0; axis < 3; axis++)
            side[axis] = ldexp((1 - at) * (node->start.hi[axis][slot] - node->start.lo[axis][slot]) +
                                   at * (node->end_hi[axis][slot] - node->end_lo[axis][slot]),
                               node->start.exponent[axis] - 127);
        sum += side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
    }
    return sum / STEPS;
}

/* The cost that is expected of rays of any time, from the boxes of both ends. */
static double expected_sah(const struct structure *structure)
{
    const struct portable_view *view = &structure->view.portable;
    struct box bounds;
    double sum = 0;
    memcpy(&bounds, view->header->bounds, sizeof bounds);
    for (uint32_t i = 0; i < view->header->node_count; i++) {
        const struct portable_node *node = portable_node_at(view, i);
        for (unsigned slot = 0; slot < 8; slot++) {
            int cost = node->inner_mask >> slot & 1 ? 1 : __builtin_popcount(node->meta[slot] >> 5);
            if (node->meta[slot])
                sum += cost * mean_half_area((const struct portable_moving_node *)node, slot);
        }
    }
    return sum / box_half_area(&bounds) + 1;
}

static void figures_add_up(void **state)
{
    (void)state;
    static struct moving_world world;
    moving_world_init(&world, 1);
    for (int i = 0; i <= TOP; i++) {
        const struct structure *structure = structure_of(&world, i);
        struct survey survey;
        assert_int_equal(survey_take(structure, &world.local.memory, &survey, NULL), BVHD_OK);
        assert_int_equal(survey.header_bytes + survey.node_bytes + survey.record_bytes + survey.vertex_bytes +
                             survey.geometry_bytes + survey.other_bytes,
                         structure->blob.size);
        assert_true(survey.other_bytes < 64);
        assert_int_equal(survey.node_bytes, survey.nodes * (structure->moves ? 128 : 80));
        assert_int_equal(*survey_find_figure(&survey, "version"), i == 1 ? 1 : 2);
        assert_int_equal(*survey_find_figure(&survey, "build_flags"), structure->moves ? BUILD_MOTION : 0);
        if (structure->moves)
            assert_true(fabs(survey.sah / expected_sah(structure) - 1) < 1e-6);
    }
    moving_world_finish(&world);
}

static void check_sheet(const struct moving_world *world, const struct oracle_mesh *mesh)
{
    assert_int_equal(mesh->motion, ORACLE_STILL);
    assert_int_equal(mesh->primitive_count, MOVING_WORLD_TRIANGLES);
    for (uint32_t k = 0; k < 3 * MOVING_WORLD_TRIANGLES; k++) {
        const size_t at = (size_t)3 * world->sheet.indices[k];
        assert_memory_equal(mesh->positions + 3 * k, world->sheet.start + at, 3 * sizeof(float));
        assert_memory_equal(mesh->end_positions + 3 * k, world->sheet.end + at, 3 * sizeof(float));
    }
}

static void unpacked_is_what_was_built(void **state)
{
    (void)state;
    static const enum oracle_motion motions[] = {ORACLE_STILL, ORACLE_MATRIX, ORACLE_SRT, ORACLE_MATRIX};
    static struct moving_world world;
    struct unpacked unpacked;
    moving_world_init(&world, 1);
    assert_int_equal(unpack_structures(&world.structures, &world.local.memory, &unpacked, NULL), BVHD_OK);
    assert_int_equal(unpacked.mesh_count, MOVING_WORLD_INSTANCES);
    assert_true(oracle_moves(unpacked.meshes, unpacked.mesh_count));
    for (uint32_t i = 0; i < unpacked.mesh_count; i++) {
        const struct oracle_mesh *mesh = &unpacked.meshes[i];
        const struct moving_place *place = &moving_places[mesh->instance];
        assert_int_equal(mesh->motion, motions[mesh->instance]);
        assert_memory_equal(mesh->transform, place->start, 12 * sizeof(float));
        assert_int_equal(mesh->end_transform != NULL, mesh->motion != ORACLE_STILL);
        if (mesh->end_transform)
            assert_memory_equal(mesh->end_transform, place->end, 16 * sizeof(float));
        if (place->bottom == SHEET)
            check_sheet(&world, mesh);
        else
            assert_null(mesh->end_positions);
    }
    unpack_finish(&unpacked);
    moving_world_finish(&world);
    assert_int_equal(world.local.memory.live, 0);
}

static void memory_may_be_short(void **state)
{
    (void)state;
    static struct moving_world world;
    enum bvhd_status status = BVHD_NO_MEMORY;
    moving_world_init(&world, 1);
    struct memory *memory = &world.local.memory;
    const uint64_t live = memory->live;
    for (int after = 0; status == BVHD_NO_MEMORY; after++) {
        struct unpacked unpacked;
        atomic_store(&memory->fail_after, after);
        status = unpack_structures(&world.structures, memory, &unpacked, NULL);
        atomic_store(&memory->fail_after, -1);
        if (status == BVHD_OK)
            unpack_finish(&unpacked);
        assert_int_equal(memory->live, live);
        assert_true(after < 100);
    }
    moving_world_finish(&world);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_rotation_may_be_nothing),
        cmocka_unit_test(contents_are_told),
        cmocka_unit_test(figures_add_up),
        cmocka_unit_test(instances_are_where_they_are_at_a_time),
        cmocka_unit_test(memory_may_be_short),
        cmocka_unit_test(triangles_are_where_they_are_at_a_time),
        cmocka_unit_test(unpacked_is_what_was_built),
    };
    return cmocka_run_group_tests_name("structure_motion", tests, NULL, NULL);
}
