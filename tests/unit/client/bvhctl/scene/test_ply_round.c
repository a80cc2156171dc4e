/* SPDX-License-Identifier: Apache-2.0 */
/* test_ply_round.c - tests points and lines of PLY files: clouds, radii, faces of one or two corners. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/scene/ply.h"
#include "tests/support/scene/ply_file.h"

static const struct import_wish both = {.point_radius = 0.5f, .line_radius = 0.25f};

static enum bvhd_status read_file(const struct ply_file *file, const struct import_wish *wish, struct memory *memory,
                                  struct import *ret_import, struct bvhd_error *error)
{
    FILE *stream = fmemopen((void *)(uintptr_t)file->bytes, file->size, "rb");
    assert_non_null(stream);
    enum bvhd_status status = ply_import_stream(stream, file->size, "x.ply", wish, memory, ret_import, error);
    fclose(stream);
    return status;
}

static void read_good(const struct ply_file *file, struct memory *memory, struct import *ret_import)
{
    struct bvhd_error error = {0};
    memory_init(memory, UINT64_MAX);
    if (read_file(file, &both, memory, ret_import, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
}

static void finish(struct import *import, struct memory *memory)
{
    import_finish(import);
    assert_int_equal(memory->live, 0);
}

static void begin(struct ply_file *file, int format, int vertices, const char *radius_type)
{
    ply_file_begin(file, format, "\n");
    ply_file_line(file, "element vertex %d", vertices);
    ply_file_line(file, "property float x");
    if (radius_type)
        ply_file_line(file, "property %s radius", radius_type);
    ply_file_line(file, "property float y");
    ply_file_line(file, "property float z");
}

/* Vertex i is at (i, 2, 3). */
static void put_vertices(struct ply_file *file, int count, const char *radius_type, const double *radii)
{
    for (int i = 0; i < count; i++) {
        ply_file_number(file, "float", i);
        if (radius_type)
            ply_file_number(file, radius_type, radii[i]);
        ply_file_number(file, "float", 2);
        ply_file_number(file, "float", 3);
        ply_file_end_row(file);
    }
}

static void clouds(void **state)
{
    static const char *const types[] = {NULL, "float", "double", "uchar"};
    static const double radii[] = {1, 0, 3};
    (void)state;
    for (int i = 0; i < 4 * PLY_FILE_FORMATS; i++) {
        const char *type = types[i % 4];
        struct ply_file file;
        struct memory memory;
        struct import import;
        begin(&file, i / 4, 3, type);
        ply_file_line(&file, "end_header");
        put_vertices(&file, 3, type, radii);
        read_good(&file, &memory, &import);
        const struct import_mesh *mesh = &import.meshes[0];
        assert_int_equal(import.mesh_count, 1);
        assert_int_equal(import.point_count, 3);
        assert_int_equal(import.triangle_count + import.line_count, 0);
        assert_false(import.has_second_reader);
        assert_int_equal(mesh->shape, IMPORT_POINTS);
        for (uint32_t k = 0; k < 3; k++) {
            assert_true(mesh->positions[3 * k] == (float)k && mesh->positions[3 * k + 2] == 3);
            assert_true(mesh->radii[k] == (type ? (float)radii[k] : 0.5f));
        }
        finish(&import, &memory);
    }
}

/* A row of a list makes the vertices of a binary file differ in size. */
static void clouds_with_lists(void **state)
{
    static const double list[] = {7, 8};
    (void)state;
    for (int format = 0; format < PLY_FILE_FORMATS; format++) {
        struct ply_file file;
        struct memory memory;
        struct import import;
        begin(&file, format, 2, "float");
        ply_file_line(&file, "property list uchar int others");
        ply_file_line(&file, "end_header");
        for (int i = 0; i < 2; i++) {
            const double values[] = {i, 4 + i, 2, 3};
            ply_file_numbers(&file, "float", values, 4);
            ply_file_list(&file, "uchar", "int", list, i + 1);
            ply_file_end_row(&file);
        }
        read_good(&file, &memory, &import);
        assert_true(import.meshes[0].radii[0] == 4 && import.meshes[0].radii[1] == 5);
        assert_true(import.meshes[0].positions[3] == 1 && import.meshes[0].positions[5] == 3);
        finish(&import, &memory);
    }
}

static void make_mixed(struct ply_file *file, bool has_triangle, const char *radius_type)
{
    static const double radii[] = {1, 2, 3, 4}, corners[] = {0, 1, 2}, point[] = {3}, line[] = {2, 3}, next[] = {3, 0};
    begin(file, 0, 4, radius_type);
    ply_file_line(file, "element face %d", 3 + has_triangle);
    ply_file_line(file, "property list uchar int vertex_indices");
    ply_file_line(file, "end_header");
    put_vertices(file, 4, radius_type, radii);
    if (has_triangle) {
        ply_file_list(file, "uchar", "int", corners, 3);
        ply_file_end_row(file);
    }
    ply_file_list(file, "uchar", "int", point, 1);
    ply_file_end_row(file);
    ply_file_list(file, "uchar", "int", line, 2);
    ply_file_end_row(file);
    ply_file_list(file, "uchar", "int", next, 2);
    ply_file_end_row(file);
}

static void faces_of_one_or_two_corners(void **state)
{
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct ply_file file;
        struct memory memory;
        struct import import;
        bool has_triangle = i & 1, has_radii = i & 2;
        make_mixed(&file, has_triangle, has_radii ? "float" : NULL);
        read_good(&file, &memory, &import);
        assert_int_equal(import.triangle_count, has_triangle);
        assert_int_equal(import.point_count, 1);
        assert_int_equal(import.line_count, 2);
        assert_int_equal(import.counts.points + import.counts.lines, 0);
        assert_int_equal(import.bottom_count, 2 + has_triangle);
        assert_int_equal(import.instance_count, 2 + has_triangle);
        assert_null(import.meshes[0].radii);
        const struct import_mesh *points = &import.meshes[1], *lines = &import.meshes[2];
        assert_true(points->shape == IMPORT_POINTS && points->vertex_count == 1 && points->positions[0] == 3);
        assert_true(points->radii[0] == (has_radii ? 4 : 0.5f));
        assert_true(lines->shape == IMPORT_LINES && lines->vertex_count == 3);
        assert_true(lines->positions[0] == 2 && lines->positions[3] == 3 && lines->positions[6] == 0);
        assert_true(lines->radii[2] == (has_radii ? 1 : 0.25f));
        finish(&import, &memory);
    }
}

/* One option alone reads its shape, and the other shape is counted. */
static void the_other_shape_is_counted(void **state)
{
    struct ply_file file;
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    (void)state;
    make_mixed(&file, true, "float");
    memory_init(&memory, UINT64_MAX);
    const struct import_wish points = {.point_radius = 1}, lines = {.line_radius = 1};
    assert_int_equal(read_file(&file, &points, &memory, &import, &error), BVHD_OK);
    assert_true(import.point_count == 1 && import.line_count == 0 && import.counts.lines == 2);
    finish(&import, &memory);
    assert_int_equal(read_file(&file, &lines, &memory, &import, &error), BVHD_OK);
    assert_true(import.line_count == 2 && import.point_count == 0 && import.counts.points == 1);
    finish(&import, &memory);
}

static void wrong_radii_are_refused(void **state)
{
    static const double radii[] = {-1, NAN, INFINITY};
    (void)state;
    for (size_t i = 0; i < sizeof radii / sizeof *radii; i++) {
        const double all[] = {1, 1, radii[i]};
        struct ply_file file;
        struct memory memory;
        struct import import;
        struct bvhd_error error = {0};
        begin(&file, 1, 3, "float");
        ply_file_line(&file, "end_header");
        put_vertices(&file, 3, "float", all);
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(read_file(&file, &both, &memory, &import, &error), BVHD_INVALID);
        assert_non_null(strstr(error.text, "the radius of vertex 2 is"));
        assert_int_equal(memory.live, 0);
    }
}

static void clouds_are_refused_without_the_option(void **state)
{
    struct ply_file file;
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    const struct import_wish lines = {.line_radius = 1};
    (void)state;
    begin(&file, 0, 1, NULL);
    ply_file_line(&file, "end_header");
    put_vertices(&file, 1, NULL, NULL);
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(read_file(&file, &lines, &memory, &import, &error), BVHD_INVALID);
    assert_non_null(strstr(error.text, "point cloud of 1 vertices, without faces; --points RADIUS reads them"));
}

/* Without the options radii are attributes like others, and may be anything. */
static void radii_of_triangles_are_ignored(void **state)
{
    static const double radii[] = {-1, 2, 3, 4}, corners[] = {0, 1, 2};
    struct ply_file file;
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    const struct import_wish nothing = {0};
    (void)state;
    begin(&file, 0, 4, "float");
    ply_file_line(&file, "element face 1");
    ply_file_line(&file, "property list uchar int vertex_indices");
    ply_file_line(&file, "end_header");
    put_vertices(&file, 4, "float", radii);
    ply_file_list(&file, "uchar", "int", corners, 3);
    ply_file_end_row(&file);
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(read_file(&file, &nothing, &memory, &import, &error), BVHD_OK);
    assert_null(import.meshes[0].radii);
    finish(&import, &memory);
}

static void read_with_little_memory(const struct ply_file *file)
{
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int after = 0; status == BVHD_NO_MEMORY; after++) {
        struct memory memory;
        struct import import;
        memory_init(&memory, UINT64_MAX);
        atomic_store(&memory.fail_after, after);
        status = read_file(file, &both, &memory, &import, NULL);
        if (status == BVHD_OK)
            import_finish(&import);
        assert_int_equal(memory.live, 0);
        assert_true(after < 1000);
    }
    assert_int_equal(status, BVHD_OK);
}

static void memory_may_be_short(void **state)
{
    static const double radii[] = {1, 2};
    struct ply_file file;
    (void)state;
    make_mixed(&file, true, "float");
    read_with_little_memory(&file);
    begin(&file, 0, 2, "float");
    ply_file_line(&file, "end_header");
    put_vertices(&file, 2, "float", radii);
    read_with_little_memory(&file);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(clouds),
        cmocka_unit_test(clouds_with_lists),
        cmocka_unit_test(faces_of_one_or_two_corners),
        cmocka_unit_test(the_other_shape_is_counted),
        cmocka_unit_test(wrong_radii_are_refused),
        cmocka_unit_test(clouds_are_refused_without_the_option),
        cmocka_unit_test(radii_of_triangles_are_ignored),
        cmocka_unit_test(memory_may_be_short),
    };
    return cmocka_run_group_tests_name("ply_round", tests, NULL, NULL);
}
