/* SPDX-License-Identifier: Apache-2.0 */
/* test_import_round.c - tests the order of the vertices of points and lines, and what is known of each shape. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/scene/import_round.h"

enum { VERTICES = 5, ROOM = 8 };

/* A mesh whose vertex i is at (i, 10 i, 100 i), with the radius i and the colour (i, i, i, i). */
static void make_mesh(struct import_mesh *mesh, enum import_shape shape, const uint32_t *indices, uint32_t count,
                      struct memory *memory)
{
    uint64_t corners = (uint64_t)count * import_shape_kinds[shape].corners;
    *mesh = (struct import_mesh){.shape = shape, .vertex_count = VERTICES, .primitive_count = count};
    mesh->positions = memory_array(memory, VERTICES, 3 * sizeof(float));
    mesh->radii = memory_array(memory, VERTICES, sizeof(float));
    mesh->look.colours = memory_array(memory, VERTICES, 4 * sizeof(float));
    mesh->look.normals = memory_array(memory, VERTICES, 3 * sizeof(float));
    mesh->indices = memory_array(memory, corners + 1, sizeof(uint32_t));
    assert_true(mesh->positions && mesh->radii && mesh->look.colours && mesh->look.normals && mesh->indices);
    for (uint32_t i = 0; i < VERTICES; i++) {
        mesh->positions[3 * i] = (float)i;
        mesh->positions[3 * i + 1] = 10 * (float)i;
        mesh->positions[3 * i + 2] = 100 * (float)i;
        mesh->radii[i] = (float)i;
        for (uint32_t k = 0; k < 4; k++)
            mesh->look.colours[4 * i + k] = (float)i;
    }
    memcpy(mesh->indices, indices, corners * sizeof *indices);
}

static void finish_mesh(struct import_mesh *mesh, struct memory *memory)
{
    memory_free(memory, mesh->positions);
    memory_free(memory, mesh->radii);
    memory_free(memory, mesh->caps);
    memory_free(memory, mesh->indices);
    import_look_finish(&mesh->look, memory);
    assert_int_equal(memory->live, 0);
}

/* Vertex i of the mesh has to be what vertex old[i] was. */
static void check_vertices(const struct import_mesh *mesh, const uint32_t *old, uint32_t count)
{
    assert_int_equal(mesh->vertex_count, count);
    for (uint32_t i = 0; i < count; i++) {
        float was = (float)old[i];
        assert_true(mesh->positions[3 * i] == was && mesh->positions[3 * i + 1] == 10 * was &&
                    mesh->positions[3 * i + 2] == 100 * was);
        assert_true(mesh->radii[i] == was && mesh->look.colours[4 * i + 3] == was);
    }
}

enum { BOTH = IMPORT_CAP_FIRST | IMPORT_CAP_SECOND, SECOND = IMPORT_CAP_SECOND };

static const struct {
    const char *name;
    uint32_t count, indices[ROOM]; /* of lines */
    uint32_t vertex_count, old[ROOM]; /* what has to come of it */
    uint32_t first[4]; /* the first ends of the lines */
    uint8_t caps[4];
} line_cases[] = {
    {"a strip", 3, {0, 1, 1, 2, 2, 3}, 4, {0, 1, 2, 3}, {0, 1, 2}, {BOTH, SECOND, SECOND}},
    {"a strip in another order", 2, {4, 1, 1, 3}, 3, {4, 1, 3}, {0, 1}, {BOTH, SECOND}},
    {"lines of their own", 2, {0, 1, 2, 3}, 4, {0, 1, 2, 3}, {0, 2}, {BOTH, BOTH}},
    {"lines that begin together", 2, {0, 1, 0, 2}, 4, {0, 1, 0, 2}, {0, 2}, {BOTH, BOTH}},
    {"a loop", 3, {0, 1, 1, 2, 2, 0}, 4, {0, 1, 2, 0}, {0, 1, 2}, {BOTH, SECOND, SECOND}},
    {"two strips", 3, {0, 1, 3, 4, 4, 0}, 5, {0, 1, 3, 4, 0}, {0, 2, 3}, {BOTH, BOTH, SECOND}},
    {"a line without length", 2, {2, 2, 2, 1}, 3, {2, 2, 1}, {0, 1}, {BOTH, SECOND}},
    {"no line", 0, {0}, 0, {0}, {0}, {0}},
};

static void lines_become_chains(void **state)
{
    (void)state;
    for (size_t c = 0; c < sizeof line_cases / sizeof *line_cases; c++) {
        struct memory memory;
        struct import_mesh mesh;
        memory_init(&memory, UINT64_MAX);
        make_mesh(&mesh, IMPORT_LINES, line_cases[c].indices, line_cases[c].count, &memory);
        assert_true(import_round_order(&mesh, &memory));
        check_vertices(&mesh, line_cases[c].old, line_cases[c].vertex_count);
        assert_null(mesh.look.normals);
        for (uint32_t i = 0; i < line_cases[c].count; i++) {
            if (mesh.indices[2 * i] != line_cases[c].first[i] || mesh.caps[i] != line_cases[c].caps[i])
                fail_msg("%s: line %u begins at %u, with caps %u", line_cases[c].name, i, mesh.indices[2 * i],
                         mesh.caps[i]);
            assert_int_equal(mesh.indices[2 * i + 1], mesh.indices[2 * i] + 1);
        }
        finish_mesh(&mesh, &memory);
    }
}

static void points_are_vertices(void **state)
{
    static const uint32_t indices[] = {3, 0, 3};
    struct memory memory;
    struct import_mesh mesh;
    (void)state;
    memory_init(&memory, UINT64_MAX);
    make_mesh(&mesh, IMPORT_POINTS, indices, 3, &memory);
    assert_true(import_round_order(&mesh, &memory));
    check_vertices(&mesh, indices, 3);
    for (uint32_t i = 0; i < 3; i++)
        assert_int_equal(mesh.indices[i], i);
    assert_null(mesh.caps);
    finish_mesh(&mesh, &memory);
}

static void triangles_stay(void **state)
{
    static const uint32_t indices[] = {3, 0, 4};
    struct memory memory;
    struct import_mesh mesh;
    (void)state;
    memory_init(&memory, UINT64_MAX);
    make_mesh(&mesh, IMPORT_TRIANGLES, indices, 1, &memory);
    assert_true(import_round_order(&mesh, &memory));
    assert_memory_equal(mesh.indices, indices, sizeof indices);
    assert_int_equal(mesh.vertex_count, VERTICES);
    assert_non_null(mesh.look.normals);
    finish_mesh(&mesh, &memory);
}

static void memory_may_be_short(void **state)
{
    bool is_done = false;
    (void)state;
    for (int after = 0; !is_done; after++) {
        struct memory memory;
        struct import_mesh mesh;
        memory_init(&memory, UINT64_MAX);
        make_mesh(&mesh, IMPORT_LINES, line_cases[0].indices, line_cases[0].count, &memory);
        atomic_store(&memory.fail_after, after);
        is_done = import_round_order(&mesh, &memory);
        finish_mesh(&mesh, &memory);
        assert_true(after < 20 && (is_done || after < 5));
    }
}

static void wrong_radii_are_found(void **state)
{
    static const float wrong[] = {-1, -1e-30f, NAN, INFINITY, -INFINITY};
    float radii[3] = {0, 1, 1e30f};
    uint32_t vertex = 9;
    (void)state;
    assert_false(import_round_find_wrong(radii, 3, &vertex));
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        radii[2] = wrong[i];
        assert_false(import_round_find_wrong(radii, 2, &vertex));
        assert_true(import_round_find_wrong(radii, 3, &vertex));
        assert_int_equal(vertex, 2);
    }
}

static void wishes_and_counts(void **state)
{
    const struct import_wish wish = {.point_radius = 2, .line_radius = 3};
    struct import_mesh meshes[] = {{.primitive_count = 5},
                                   {.shape = IMPORT_LINES, .primitive_count = 7},
                                   {.shape = IMPORT_POINTS, .primitive_count = 11},
                                   {.shape = IMPORT_LINES, .primitive_count = 13}};
    struct import import = {.meshes = meshes, .mesh_count = 4};
    (void)state;
    assert_true(import_round_radius(&wish, IMPORT_POINTS) == 2 && import_round_radius(&wish, IMPORT_LINES) == 3);
    assert_false(import_round_any(&import));
    import_round_count(&import);
    assert_true(import_round_any(&import));
    assert_int_equal(import.triangle_count, 5);
    assert_int_equal(import.point_count, 11);
    assert_int_equal(import.line_count, 20);
    assert_int_equal(import_corner_count(&meshes[1]), 14);
    assert_string_equal(import_round_hint(&(struct import_counts){.points = 1}), "; --points RADIUS reads points");
    assert_string_equal(import_round_hint(&(struct import_counts){.lines = 1}), "; --lines RADIUS reads lines");
    assert_string_equal(import_round_hint(&(struct import_counts){.lost = 1}), "");
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(lines_become_chains),   cmocka_unit_test(points_are_vertices),
        cmocka_unit_test(triangles_stay),        cmocka_unit_test(memory_may_be_short),
        cmocka_unit_test(wrong_radii_are_found), cmocka_unit_test(wishes_and_counts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
