/* SPDX-License-Identifier: Apache-2.0 */
/* test_unpack.c - tests that points and lines are built, read and unpacked as they are, and how surfaces face. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/picture/surface.h"
#include "client/bvhctl/scene/activity.h"
#include "client/bvhctl/scene/import_round.h"
#include "client/bvhctl/scene/unpack.h"
#include "tests/support/client/bvhctl/test_world.h"

enum { POINTS = 6, LINES = 4, VERTICES = 6 };

/* A chain of three lines and a line of its own. Point 4 has no radius, and point 5 is not a number. */
static char name[] = "round";
static float point_positions[3 * POINTS], point_radii[POINTS], line_positions[3 * VERTICES], line_radii[VERTICES];
static uint32_t point_indices[POINTS] = {0, 1, 2, 3, 4, 5}, line_indices[2 * LINES] = {0, 1, 1, 2, 2, 3, 4, 5};
static uint8_t line_caps[LINES] = {3, 2, 2, 3};
static struct import_mesh meshes[] = {{.name = name,
                                       .material = name,
                                       .shape = IMPORT_POINTS,
                                       .positions = point_positions,
                                       .radii = point_radii,
                                       .indices = point_indices,
                                       .vertex_count = POINTS,
                                       .primitive_count = POINTS},
                                      {.name = name,
                                       .material = name,
                                       .shape = IMPORT_LINES,
                                       .positions = line_positions,
                                       .radii = line_radii,
                                       .caps = line_caps,
                                       .indices = line_indices,
                                       .vertex_count = VERTICES,
                                       .primitive_count = LINES}};
static uint32_t lists[2] = {0, 1};
static struct import_bottom bottoms[] = {{name, lists, 1}, {name, lists + 1, 1}};
static struct import_instance instances[] = {{.bottom = 0, .transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}},
                                             {.bottom = 1, .transform = {2, 0, 0, 0, 0, 2, 0, 50, 0, 0, 2, 0}}};

static void open_world(struct test_world *world)
{
    for (uint32_t i = 0; i < POINTS; i++) {
        point_positions[3 * i] = 4 * (float)i;
        point_radii[i] = i == 4 ? 0 : 1;
        line_positions[3 * i] = 3 * (float)i;
        line_positions[3 * i + 1] = (float)(i % 2);
        line_radii[i] = 0.5f + 0.1f * (float)i;
    }
    point_positions[3 * 5] = NAN;
    const struct import import = {.name = name,
                                  .meshes = meshes,
                                  .bottoms = bottoms,
                                  .instances = instances,
                                  .mesh_count = 2,
                                  .bottom_count = 2,
                                  .instance_count = 2,
                                  .point_count = POINTS,
                                  .line_count = LINES};
    test_world_init_from(world, 1, &import);
}

static const struct structure *bottom_of(const struct test_world *world, uint32_t instance)
{
    const struct structure *top = structures_top(&world->structures);
    for (uint32_t row = 0; row < structure_instance_count(top); row++)
        if (structure_instance(top, row).instance == instance)
            return &world->structures.files[structure_instance(top, row).bottom].structure;
    fail_msg("there is no instance %u", instance);
    return NULL;
}

/* An end of a row has to be vertex `vertex` of the mesh. */
static void check_end(const float end[4], const struct import_mesh *mesh, uint32_t vertex)
{
    assert_memory_equal(end, mesh->positions + 3 * vertex, 3 * sizeof *end);
    assert_memory_equal(end + 3, mesh->radii + vertex, sizeof *end);
}

static void rows_are_exact(void **state)
{
    struct test_world world;
    uint32_t seen = 0;
    (void)state;
    open_world(&world);
    const struct structure *points = bottom_of(&world, 0), *lines = bottom_of(&world, 1);
    assert_int_equal(points->content, CONTENT_SPHERES);
    assert_int_equal(lines->content, CONTENT_SWEPT_SPHERES);
    assert_int_equal(structure_triangle_count(points) + structure_triangle_count(lines), 0);
    assert_int_equal(structure_round_count(points), POINTS - 2);
    assert_int_equal(structure_round_count(lines), LINES);
    assert_int_equal(structure_round_count(structures_top(&world.structures)), 0);
    for (uint32_t row = 0; row < POINTS - 2; row++) {
        struct structure_round round = structure_round(points, row);
        check_end(round.ends[0], &meshes[0], round.primitive);
        check_end(round.ends[1], &meshes[0], round.primitive);
        assert_int_equal(round.caps, 0);
    }
    for (uint32_t row = 0; row < LINES; row++) {
        struct structure_round round = structure_round(lines, row);
        check_end(round.ends[0], &meshes[1], line_indices[2 * round.primitive]);
        check_end(round.ends[1], &meshes[1], line_indices[2 * round.primitive + 1]);
        assert_int_equal(round.caps, line_caps[round.primitive]);
        seen |= 1u << round.primitive;
    }
    assert_int_equal(seen, (1u << LINES) - 1);
    test_world_finish(&world);
}

static void unpacked_is_what_was_built(void **state)
{
    struct test_world world;
    struct unpacked unpacked;
    (void)state;
    open_world(&world);
    assert_int_equal(unpack_structures(&world.structures, &world.local.memory, &unpacked, NULL), BVHD_OK);
    assert_int_equal(unpacked.mesh_count, 2);
    assert_int_equal(unpacked.primitive_count, POINTS + LINES);
    for (uint32_t i = 0; i < 2; i++) {
        const struct oracle_mesh *mesh = &unpacked.meshes[i];
        if (mesh->instance == 0) {
            assert_int_equal(mesh->shape, ORACLE_SPHERES);
            assert_memory_equal(mesh->positions, point_positions, 4 * 3 * sizeof(float));
            assert_memory_equal(mesh->radii, point_radii, 4 * sizeof(float));
            assert_true(isnan(mesh->positions[12]) && isnan(mesh->positions[15]));
            assert_null(mesh->caps);
            continue;
        }
        assert_int_equal(mesh->shape, ORACLE_SWEPT_SPHERES);
        assert_memory_equal(mesh->caps, line_caps, LINES);
        for (uint32_t k = 0; k < 2 * LINES; k++) {
            assert_memory_equal(mesh->positions + 3 * k, line_positions + 3 * line_indices[k], 3 * sizeof(float));
            assert_true(mesh->radii[k] == line_radii[line_indices[k]]);
        }
    }
    unpack_finish(&unpacked);
    unpack_finish(&unpacked);
    test_world_finish(&world);
}

static void memory_may_be_short(void **state)
{
    struct test_world world;
    enum bvhd_status status = BVHD_NO_MEMORY;
    (void)state;
    open_world(&world);
    uint64_t live = world.local.memory.live;
    for (int after = 0; status == BVHD_NO_MEMORY; after++) {
        struct unpacked unpacked;
        atomic_store(&world.local.memory.fail_after, after);
        status = unpack_structures(&world.structures, &world.local.memory, &unpacked, NULL);
        atomic_store(&world.local.memory.fail_after, -1);
        if (status == BVHD_OK)
            unpack_finish(&unpacked);
        assert_int_equal(world.local.memory.live, live);
        assert_true(after < 100);
    }
    test_world_finish(&world);
}

/* The oracle gets the same from the file as from the structures. */
static void the_import_gives_the_same(void **state)
{
    struct test_world world;
    struct oracle_mesh *list;
    uint32_t count;
    (void)state;
    open_world(&world);
    assert_int_equal(import_oracle_meshes(&world.import, true, &list, &count, NULL), BVHD_OK);
    assert_int_equal(count, 2);
    assert_true(list[0].shape == ORACLE_SPHERES && list[0].radii == point_radii && !list[0].caps);
    assert_true(list[1].shape == ORACLE_SWEPT_SPHERES && list[1].caps == line_caps);
    assert_true(list[0].primitive_count == POINTS && list[1].primitive_count == LINES);
    memory_free(world.import.memory, list);
    struct activity points = activity_of(&meshes[0]), lines = activity_of(&meshes[1]);
    assert_true(points.inactive == 1 && points.degenerate == 1 && points.infinite == 0);
    assert_true(lines.inactive + lines.degenerate + lines.infinite == 0);
    point_positions[4] = INFINITY;
    assert_int_equal(activity_of(&meshes[0]).infinite, 1);
    point_positions[4] = 0;
    test_world_finish(&world);
}

static void normals_point_to_the_viewer(void **state)
{
    struct test_world world;
    struct surfaces surfaces;
    struct ray_hit hit;
    struct stage_hit met;
    (void)state;
    open_world(&world);
    assert_int_equal(surfaces_init(&surfaces, &world.structures, &world.local.memory, NULL), BVHD_OK);
    struct ray ray = stage_ray(vector_make(4, 0, 10), vector_make(0, 0, -1), 0);
    assert_true(structures_trace(&world.structures, &ray, &hit));
    struct tracer_hit made = tracer_hit_of(&hit);
    assert_true(surfaces_meet(&surfaces, &ray, &made, &met));
    assert_true(!met.is_box && !met.is_back && met.primitive == 1 && met.instance == 0);
    assert_true(vector_length(vector_sub(met.normal, vector_make(0, 0, 1))) < 1e-6);
    assert_true(vector_length(vector_sub(met.position, vector_make(4, 0, 1))) < 1e-6);
    /* The side of the first line, whose instance is twice as large and lifted: normals lean by how fast it widens. */
    ray = stage_ray(vector_make(3, 100, 0.2), vector_make(0, -1, 0), 0);
    assert_true(structures_trace(&world.structures, &ray, &hit));
    made = tracer_hit_of(&hit);
    assert_true(surfaces_meet(&surfaces, &ray, &made, &met));
    assert_true(met.instance == 1 && met.primitive == 0 && met.u > 0 && met.u < 1);
    double slope = ((double)line_radii[0] - (double)line_radii[1]) / sqrt(10);
    assert_true(fabs(vector_dot(met.normal, vector_unit(vector_make(3, 1, 0))) - slope) < 1e-5);
    assert_true(met.normal.y > 0.8 && met.normal.z > 0);
    made.primitive = LINES;
    assert_false(surfaces_meet(&surfaces, &ray, &made, &met));
    surfaces_finish(&surfaces);
    test_world_finish(&world);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_are_exact),
        cmocka_unit_test(unpacked_is_what_was_built),
        cmocka_unit_test(memory_may_be_short),
        cmocka_unit_test(the_import_gives_the_same),
        cmocka_unit_test(normals_point_to_the_viewer),
    };
    return cmocka_run_group_tests_name("unpack", tests, NULL, NULL);
}
