/* SPDX-License-Identifier: Apache-2.0 */
/* test_ply.c - tests that PLY files of every format, type and order of elements are read completely and bit by bit. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/scene/ply.h"
#include "tests/support/scene/ply_file.h"
#include "tests/support/scratch.h"

static const struct import_wish no_points;

static enum bvhd_status read_bytes(const void *data, size_t size, struct memory *memory, struct import *ret_import,
                                   struct bvhd_error *error)
{
    FILE *file = fmemopen((void *)(uintptr_t)data, size, "rb");
    assert_non_null(file);
    enum bvhd_status status = ply_import_stream(file, size, "dir/a file.ply", &no_points, memory, ret_import, error);
    fclose(file);
    return status;
}

static void read_good(const struct ply_file *file, struct memory *memory, struct import *ret_import)
{
    struct bvhd_error error = {0};
    memory_init(memory, UINT64_MAX);
    if (read_bytes(file->bytes, file->size, memory, ret_import, &error))
        fail_msg("%s: %s", error.where, error.text);
}

static void finish(struct import *import, struct memory *memory)
{
    import_finish(import);
    assert_int_equal(memory->live, 0);
}

static void check_sample(const struct import *import, const struct ply_expected *expected)
{
    const struct import_mesh *mesh = &import->meshes[0];
    float min[3] = {INFINITY, INFINITY, INFINITY}, max[3] = {-INFINITY, -INFINITY, -INFINITY};
    assert_int_equal(mesh->vertex_count, expected->vertices);
    assert_int_equal(mesh->primitive_count, expected->triangles);
    assert_int_equal(import->triangle_count, expected->triangles);
    for (uint32_t i = 0; i < 3 * mesh->vertex_count; i++) {
        min[i % 3] = fminf(min[i % 3], mesh->positions[i]);
        max[i % 3] = fmaxf(max[i % 3], mesh->positions[i]);
    }
    assert_memory_equal(min, expected->min, sizeof min);
    assert_memory_equal(max, expected->max, sizeof max);
    for (uint32_t i = 0; i < 3 * mesh->primitive_count; i++)
        assert_true(mesh->indices[i] < mesh->vertex_count);
    assert_int_equal(import->counts.points, expected->points);
    assert_int_equal(import->counts.lines, expected->lines);
    assert_int_equal(import->counts.empty_faces, expected->empty_faces);
    assert_int_equal(import->counts.unknown_rows, expected->unknown_rows);
    assert_int_equal(import->counts.fanned + import->counts.extra_bytes + import->counts.unknown_lines, 0);
}

static void test_samples(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < PLY_FILE_SAMPLES; i++) {
        struct ply_file file;
        struct ply_expected expected;
        struct memory memory;
        struct import import;
        ply_file_sample(i, &file, &expected);
        read_good(&file, &memory, &import);
        check_sample(&import, &expected);
        assert_int_equal(import.mesh_count, 1);
        assert_int_equal(import.bottom_count, 1);
        assert_int_equal(import.instance_count, 1);
        assert_int_equal(import.reader, IMPORT_BY_PLY);
        assert_string_equal(import.name, "a file");
        assert_string_equal(import.files[0], "dir/a file.ply");
        finish(&import, &memory);
    }
}

/* The formats of a sample differ, but what is read from them does not. */
static void test_formats_agree(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < PLY_FILE_SAMPLES; i += PLY_FILE_FORMATS) {
        struct memory memory[PLY_FILE_FORMATS];
        struct import import[PLY_FILE_FORMATS];
        for (uint32_t k = 0; k < PLY_FILE_FORMATS; k++) {
            struct ply_file file;
            struct ply_expected expected;
            ply_file_sample(i + k, &file, &expected);
            read_good(&file, &memory[k], &import[k]);
            const struct import_mesh *mesh = &import[k].meshes[0], *first = &import[0].meshes[0];
            assert_memory_equal(mesh->positions, first->positions, 12 * mesh->vertex_count);
            assert_memory_equal(mesh->indices, first->indices, 12 * mesh->primitive_count);
        }
        for (uint32_t k = 0; k < PLY_FILE_FORMATS; k++)
            finish(&import[k], &memory[k]);
    }
}

static const char *const types[] = {"char",   "int8",   "uchar", "uint8",   "short",  "int16",
                                    "ushort", "uint16", "int",   "int32",   "uint",   "uint32",
                                    "int64",  "uint64", "float", "float32", "double", "float64"};

enum { TYPES = (int)(sizeof types / sizeof types[0]), FIRST_FLOAT = 14 };

/* Two triangles with coordinates, list lengths and indices of given types. */
static void make_typed(struct ply_file *file, int format, const char *coordinate, const char *length, const char *index)
{
    static const double corners[] = {0, 1, 2, 3, 2, 1};
    ply_file_begin(file, format, "\n");
    ply_file_line(file, "element vertex 4");
    ply_file_line(file, "property %s x\nproperty %s y\nproperty %s z", coordinate, coordinate, coordinate);
    ply_file_line(file, "element face 2");
    ply_file_line(file, "property list %s %s vertex_indices\nend_header", length, index);
    for (int i = 0; i < 12; i++) {
        ply_file_number(file, coordinate, i * 10);
        if (i % 3 == 2)
            ply_file_end_row(file);
    }
    for (int i = 0; i < 2; i++) {
        ply_file_list(file, length, index, corners + 3 * i, 3);
        ply_file_end_row(file);
    }
}

static void check_typed(const struct ply_file *file)
{
    static const uint32_t corners[] = {0, 1, 2, 3, 2, 1};
    struct memory memory;
    struct import import;
    read_good(file, &memory, &import);
    assert_int_equal(import.meshes[0].vertex_count, 4);
    assert_int_equal(import.meshes[0].primitive_count, 2);
    for (int i = 0; i < 12; i++)
        assert_true(import.meshes[0].positions[i] == (float)(i * 10));
    assert_memory_equal(import.meshes[0].indices, corners, sizeof corners);
    finish(&import, &memory);
}

static void test_types(void **state)
{
    (void)state;
    struct ply_file file;
    for (int format = 0; format < PLY_FILE_FORMATS; format++)
        for (int i = 0; i < TYPES; i++)
            for (int k = 0; k < TYPES; k++) {
                make_typed(&file, format, types[i], "uchar", types[k]);
                check_typed(&file);
                make_typed(&file, format, types[k], types[i % FIRST_FLOAT], "int");
                check_typed(&file);
            }
}

/* Negative and fractional numbers, and the ends of the ranges. */
static void test_values(void **state)
{
    (void)state;
    static const struct {
        const char *type;
        double value;
    } cases[] = {{"char", -128},
                 {"uchar", 255},
                 {"short", -32768},
                 {"ushort", 65535},
                 {"int", -2147483648.0},
                 {"uint", 4294967295.0},
                 {"float", -0.1f},
                 {"double", 0.1},
                 {"double", 1e300},
                 {"float", 1e-42f},
                 {"int64", -9007199254740992.0},
                 {"float", -0.0}};
    for (int format = 0; format < PLY_FILE_FORMATS; format++)
        for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
            static const double face[] = {0, 0, 0};
            struct ply_file file;
            struct memory memory;
            struct import import;
            ply_file_begin(&file, format, "\n");
            ply_file_line(&file, "element vertex 1\nproperty float y\nproperty %s x\nproperty int z", cases[i].type);
            ply_file_line(&file, "element face 1\nproperty list uchar int vertex_indices\nend_header");
            ply_file_number(&file, "float", 7);
            ply_file_number(&file, cases[i].type, cases[i].value);
            ply_file_number(&file, "int", -9);
            ply_file_end_row(&file);
            ply_file_list(&file, "uchar", "int", face, 3);
            ply_file_end_row(&file);
            read_good(&file, &memory, &import);
            const float expected[3] = {(float)cases[i].value, 7, -9};
            assert_memory_equal(import.meshes[0].positions, expected, sizeof expected);
            finish(&import, &memory);
        }
}

/* Bits of NaN, even of a signalling one, are kept. */
static void test_nan_bits(void **state)
{
    (void)state;
    static const uint32_t bits[3] = {0x7f812345, 0xffc00001, 0x7f800000};
    static const double face[] = {0, 0, 0};
    struct ply_file file;
    struct memory memory;
    struct import import;
    ply_file_begin(&file, 1, "\n");
    ply_file_line(&file, "element vertex 1\nproperty float x\nproperty float y\nproperty float z");
    ply_file_line(&file, "element face 1\nproperty list uchar int vertex_indices\nend_header");
    for (int i = 0; i < 3; i++)
        ply_file_number(&file, "uint", bits[i]);
    ply_file_list(&file, "uchar", "int", face, 3);
    read_good(&file, &memory, &import);
    assert_memory_equal(import.meshes[0].positions, bits, sizeof bits);
    finish(&import, &memory);
}

static const char text_header[] =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty double y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_index\nend_header\n";

static void read_text(const char *body, struct memory *memory, struct import *ret_import)
{
    struct ply_file file;
    file.size = (size_t)snprintf((char *)file.bytes, sizeof file.bytes, "%s%s", text_header, body);
    read_good(&file, memory, ret_import);
}

/* Text that programs write: NaN and infinity in all spellings, comments and empty lines, rows over several lines. */
static void test_text(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    read_text("nan -inf 1.#INF\n\n  1e3\t+2 -1.#IND \ncomment between rows\n0x1p-1 1.5\n.25\n3 0 1\n2", &memory,
              &import);
    const float *p = import.meshes[0].positions;
    assert_true(isnan(p[0]) && p[1] == -INFINITY && p[2] == INFINITY);
    assert_true(p[3] == 1000 && p[4] == 2 && isnan(p[5]));
    assert_true(p[6] == 0.5f && p[7] == 1.5f && p[8] == 0.25f);
    assert_int_equal(import.meshes[0].primitive_count, 1);
    finish(&import, &memory);
}

/* Comments end with any end of a line, or with the file; a word that is none may be cut off there. */
static void test_ends_of_comments(void **state)
{
    (void)state;
    static const char *const ends[] = {"comment a\rcomment b\r", "comment a", "obj_info", "comm", "obj_inf"};
    static const uint64_t extra[] = {0, 0, 0, 4, 7};
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        struct memory memory;
        struct import import;
        char body[100];
        snprintf(body, sizeof body, "0 0 0\rcomment\r1 0 0\r0 1 0\r3 0 1 2\r%s", ends[i]);
        read_text(body, &memory, &import);
        assert_int_equal(import.meshes[0].primitive_count, 1);
        assert_int_equal(import.counts.extra_bytes, extra[i]);
        finish(&import, &memory);
    }
}

/* Text is rounded once: through double, this number would become another float. */
static void test_rounding(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    read_text("1.00000005960464480 0 0\n0 0 0\n0 0 0\n3 0 1 2\n", &memory, &import);
    assert_true(import.meshes[0].positions[0] == 1.00000012f);
    finish(&import, &memory);
}

/* Bytes after the last row, and lines of the header that mean nothing, are counted. */
static void test_counted(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    read_text("0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n5 5 5\n", &memory, &import);
    assert_int_equal(import.counts.extra_bytes, 6);
    finish(&import, &memory);
    struct ply_file file;
    ply_file_begin(&file, 0, "\n");
    ply_file_line(&file, "Created by a program\nelement vertex 1\nproperty int x\nproperty int y\nproperty int z");
    ply_file_line(&file, "element face 1\nproperty list uchar int vertex_indices\nend_header\n1 2 3\n3 0 0 0");
    read_good(&file, &memory, &import);
    assert_int_equal(import.counts.unknown_lines, 1);
    finish(&import, &memory);
}

static void test_strip_order(void **state)
{
    (void)state;
    static const uint32_t expected[] = {0, 1, 2, 2, 1, 3, 2, 3, 4, 7, 8, 9};
    struct ply_file file;
    struct ply_expected ignored;
    struct memory memory;
    struct import import;
    ply_file_sample(10, &file, &ignored);
    read_good(&file, &memory, &import);
    assert_memory_equal(import.meshes[0].indices, expected, sizeof expected);
    finish(&import, &memory);
}

/* An unsigned index that has all bits set ends a strip, as -1 does. */
static void test_unsigned_restart(void **state)
{
    (void)state;
    static const double strip[] = {0, 1, 2, 4294967295.0, 1, 2, 3};
    static const uint32_t expected[] = {0, 1, 2, 1, 2, 3};
    for (int format = 0; format < PLY_FILE_FORMATS; format++) {
        struct ply_file file;
        struct memory memory;
        struct import import;
        ply_file_begin(&file, format, "\n");
        ply_file_line(&file, "element vertex 4\nproperty int x\nproperty int y\nproperty int z");
        ply_file_line(&file, "element tristrips 1\nproperty list int uint vertex_indices\nend_header");
        for (int i = 0; i < 12; i++) {
            ply_file_number(&file, "int", i * i);
            if (i % 3 == 2)
                ply_file_end_row(&file);
        }
        ply_file_list(&file, "int", "uint", strip, 7);
        ply_file_end_row(&file);
        read_good(&file, &memory, &import);
        assert_int_equal(import.meshes[0].primitive_count, 2);
        assert_memory_equal(import.meshes[0].indices, expected, sizeof expected);
        finish(&import, &memory);
    }
}

static void check_corners(const char *faces, uint32_t face_count, const uint32_t *expected, uint32_t triangle_count)
{
    struct ply_file file;
    struct memory memory;
    struct import import;
    ply_file_begin(&file, 0, "\n");
    ply_file_line(&file, "element vertex 4\nproperty int x\nproperty int y\nproperty int z");
    ply_file_line(&file, "element face %u\nproperty list uchar int vertex_indices\nend_header", face_count);
    ply_file_line(&file, "0 0 0\n1 0 0\n1 1 0\n0 1 0\n%s", faces);
    read_good(&file, &memory, &import);
    assert_int_equal(import.meshes[0].primitive_count, triangle_count);
    assert_memory_equal(import.meshes[0].indices, expected, triangle_count * 12);
    finish(&import, &memory);
}

/* Triangles keep their corners; only beside polygons, or faces without corners, some are rotated as by assimp. */
static void test_corners(void **state)
{
    (void)state;
    static const uint32_t kept[] = {0, 1, 2, 0, 2, 3, 0, 1, 3};
    static const uint32_t rotated[] = {0, 1, 2, 3, 0, 2, 0, 1, 2, 0, 2, 3, 2, 0, 1, 2, 3, 0, 0, 1, 3};
    check_corners("3 0 1 2\n3 0 2 3\n2 0 1\n3 0 1 3", 4, kept, 3);
    check_corners("3 0 1 2\n3 0 2 3\n4 0 1 2 3\n4 0 1 2 3\n3 0 1 3", 5, rotated, 7);
    check_corners("3 0 1 2\n3 0 2 3\n0", 3, rotated, 2);
}

/* A file is PLY by its first line, however that ends, or by its name. */
static void test_first_lines(void **state)
{
    static const struct {
        const char *name, *text;
        bool is_ply;
    } files[] = {{"p", "ply\n", true},      {"p", "ply\r\n", true},  {"p", "ply ", false},   {"p", "ply", false},
                 {"a name", "text", false}, {"a.PLY", "text", true}, {".ply", "text", false}};
    assert_int_equal(scratch_enter(state), 0);
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        FILE *file = fopen(files[i].name, "wb");
        assert_true(file && fputs(files[i].text, file) >= 0 && fclose(file) == 0);
        assert_int_equal(ply_is_file(files[i].name), files[i].is_ply);
    }
    assert_int_equal(scratch_remove(state), 0);
}

static void test_files(void **state)
{
    (void)state;
    char path[] = "/tmp/bvhd-test-ply-XXXXXX.ply";
    int descriptor = mkstemps(path, 4);
    FILE *file = fdopen(descriptor, "wb");
    struct ply_file sample;
    struct ply_expected expected;
    struct memory memory;
    struct import import;
    struct bvhd_error error;
    ply_file_sample(4, &sample, &expected);
    assert_int_equal(fwrite(sample.bytes, 1, sample.size, file), sample.size);
    fclose(file);
    memory_init(&memory, UINT64_MAX);
    assert_true(ply_is_file(path));
    assert_int_equal(ply_import(path, &no_points, &memory, &import, &error), BVHD_OK);
    check_sample(&import, &expected);
    finish(&import, &memory);
    remove(path);
    assert_false(ply_is_file(path));
    assert_false(ply_is_file("/tmp"));
    assert_int_equal(ply_import(path, &no_points, &memory, &import, &error), BVHD_IO);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_samples),
        cmocka_unit_test(test_formats_agree),
        cmocka_unit_test(test_types),
        cmocka_unit_test(test_values),
        cmocka_unit_test(test_nan_bits),
        cmocka_unit_test(test_text),
        cmocka_unit_test(test_rounding),
        cmocka_unit_test(test_counted),
        cmocka_unit_test(test_strip_order),
        cmocka_unit_test(test_corners),
        cmocka_unit_test(test_files),
        cmocka_unit_test(test_ends_of_comments),
        cmocka_unit_test(test_unsigned_restart),
        cmocka_unit_test(test_first_lines),
    };
    return cmocka_run_group_tests_name("ply", tests, NULL, NULL);
}
