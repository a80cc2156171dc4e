/* SPDX-License-Identifier: Apache-2.0 */
/* test_weld.c - tests that vertices at the same place become one, and that triangles keep their corners bit by bit. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/scene/weld.h"
#include "tests/support/random.h"

/* An import of one mesh, whose arrays are its own. */
static struct import make_import(struct memory *memory, const float *positions, uint32_t vertices,
                                 const uint32_t *indices, uint32_t triangles)
{
    struct import import = {.memory = memory, .mesh_count = 1};
    import.meshes = memory_alloc(memory, sizeof *import.meshes);
    assert_non_null(import.meshes);
    struct import_mesh *mesh = import.meshes;
    *mesh = (struct import_mesh){.vertex_count = vertices, .primitive_count = triangles};
    mesh->positions = memory_array(memory, vertices + 1, 12);
    mesh->indices = memory_array(memory, triangles + 1, 12);
    assert_true(mesh->positions && mesh->indices);
    memcpy(mesh->positions, positions, vertices * sizeof(float) * 3);
    memcpy(mesh->indices, indices, triangles * sizeof(uint32_t) * 3);
    return import;
}

static void test_places(void **state)
{
    (void)state;
    const float positions[8][3] = {{0, 0, 0},     {1, 0, 0},   {0, 1, 0},   {1, 0, 0},
                                   {-0.0f, 0, 0}, {NAN, 2, 3}, {NAN, 2, 3}, {0, 1, 0}};
    const uint32_t indices[9] = {0, 1, 2, 3, 7, 4, 5, 6, 0}, expected[9] = {0, 1, 2, 1, 2, 3, 4, 4, 0};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct import import = make_import(&memory, positions[0], 8, indices, 3);
    assert_true(weld_import(&import));
    assert_int_equal(import.meshes[0].vertex_count, 5);
    assert_int_equal(import.meshes[0].primitive_count, 3);
    assert_memory_equal(import.meshes[0].indices, expected, sizeof expected);
    assert_memory_equal(import.meshes[0].positions + 9, positions[4], 12);
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

static void test_empty(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const float none[3] = {0};
    const uint32_t nothing[3] = {0};
    struct import import = make_import(&memory, none, 0, nothing, 0);
    assert_true(weld_import(&import));
    assert_int_equal(import.meshes[0].vertex_count, 0);
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

/* Random corners on a grid: each triangle has the same three positions afterwards, and no two vertices are equal. */
static void test_random(void **state)
{
    (void)state;
    enum { TRIANGLES = 5000, CORNERS = 3 * TRIANGLES, SIDE = 17 };
    static float positions[CORNERS][3];
    static uint32_t indices[CORNERS];
    struct random random = {5};
    for (uint32_t i = 0; i < CORNERS; i++) {
        indices[i] = (uint32_t)(random_next(&random) % CORNERS);
        for (int axis = 0; axis < 3; axis++)
            positions[i][axis] = (float)(random_next(&random) % SIDE);
    }
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct import import = make_import(&memory, positions[0], CORNERS, indices, TRIANGLES);
    assert_true(weld_import(&import));
    const struct import_mesh *mesh = &import.meshes[0];
    assert_true(mesh->vertex_count <= SIDE * SIDE * SIDE);
    static bool is_there[SIDE * SIDE * SIDE];
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        const float *at = mesh->positions + 3 * (size_t)i;
        size_t cell = (size_t)at[0] + SIDE * ((size_t)at[1] + SIDE * (size_t)at[2]);
        assert_false(is_there[cell]);
        is_there[cell] = true;
    }
    for (uint32_t i = 0; i < CORNERS; i++)
        assert_memory_equal(mesh->positions + 3 * (size_t)mesh->indices[i], positions[indices[i]], 12);
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

static void test_no_memory(void **state)
{
    (void)state;
    static float positions[6000][3];
    const uint32_t indices[3] = {0, 1, 2};
    bool ok = false;
    for (uint32_t i = 0; i < 6000; i++)
        positions[i][0] = (float)i;
    for (int64_t after = 0; !ok; after++) {
        struct memory memory;
        memory_init(&memory, UINT64_MAX);
        struct import import = make_import(&memory, positions[0], 6000, indices, 1);
        atomic_store(&memory.fail_after, after);
        ok = weld_import(&import);
        assert_true(ok == (after > 3)); /* the numbers, and tables of three sizes */
        import_finish(&import);
        assert_int_equal(memory.live, 0);
        assert_true(after < 20);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_places),
        cmocka_unit_test(test_empty),
        cmocka_unit_test(test_random),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests_name("weld", tests, NULL, NULL);
}
