/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_ply_broken.c - tests that broken PLY files are refused by name, at any length and after any mutation, in bounded
 * memory.
 */
#include "tests/support/unit.h"

#include "client/bvhctl/scene/ply.h"
#include "client/bvhctl/scene/ply_source.h"
#include "tests/support/random.h"
#include "tests/support/scene/ply_file.h"

static const struct import_wish no_points;

static enum bvhd_status read_bytes(const void *data, size_t size, struct memory *memory, struct import *ret_import,
                                   struct bvhd_error *error)
{
    FILE *file = fmemopen((void *)(uintptr_t)data, size, "rb");
    assert_non_null(file);
    enum bvhd_status status = ply_import_stream(file, size, "x.ply", &no_points, memory, ret_import, error);
    fclose(file);
    return status;
}

/* Reads anything. The result is an import that is sound or an error that has a text, in memory that is bounded. */
static enum bvhd_status read_any(const void *data, size_t size)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = read_bytes(data, size, &memory, &import, &error);
    if (status) {
        assert_true(status == BVHD_INVALID || status == BVHD_UNSUPPORTED);
        assert_int_equal(error.status, status);
        assert_string_equal(error.where, "x.ply");
        assert_true(error.text[0]);
    } else {
        const struct import_mesh *mesh = &import.meshes[0];
        assert_true(mesh->primitive_count > 0 && mesh->vertex_count > 0);
        for (uint32_t i = 0; i < 3 * mesh->primitive_count; i++)
            assert_true(mesh->indices[i] < mesh->vertex_count);
        import_finish(&import);
    }
    assert_int_equal(memory.live, 0);
    assert_true(memory.peak <= 100 * size + 400000);
    return status;
}

static void expect_text(const char *file, const char *expected)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    assert_true(read_bytes(file, strlen(file), &memory, &import, &error) != BVHD_OK);
    if (!strstr(error.text, expected))
        fail_msg("'%s' instead of '%s'", error.text, expected);
    assert_int_equal(memory.live, 0);
}

#define HEAD "ply\nformat ascii 1.0\n"
#define POINTS "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
#define FACES "element face 2\nproperty list uchar int vertex_indices\n"
#define END "end_header\n"
#define ROWS "0 0 0\n1 0 0\n0 1 0\n"

static void test_headers(void **state)
{
    (void)state;
    expect_text("solid x\n", "does not begin with a line that says 'ply'");
    expect_text("plyx\n", "does not begin with a line that says 'ply'");
    expect_text("ply\n", "cut off in the header, in line 2");
    expect_text(HEAD POINTS FACES "end_heade", "cut off in the header, in line 9");
    expect_text("ply\n" POINTS FACES END, "has no format");
    expect_text("ply\nformat ascii 1.0\nformat ascii 1.0\n" END, "two formats");
    expect_text("ply\nformat ascii 2.0\n" END, "version 2.0");
    expect_text("ply\nformat binary_middle_endian 1.0\n" END, "no format 'binary_middle_endian'");
    expect_text("ply\nformat ascii\n" END, "line 2 of the header");
    expect_text(HEAD "property float x\n" END, "line 3 of the header has a property without an element");
    expect_text(HEAD "element vertex\n" END, "line 3 of the header");
    expect_text(HEAD "element vertex -3\n" END, "line 3 of the header");
    expect_text(HEAD "element vertex 3 3\n" END, "line 3 of the header");
    expect_text(HEAD "element vertex 99999999999999999999\n" END, "line 3 of the header");
    expect_text(HEAD POINTS "property float x\n" END, "property 'x' twice");
    expect_text(HEAD POINTS POINTS END, "element 'vertex' is in the header twice");
    expect_text(HEAD POINTS "property quad w\n" END, "no type 'quad'");
    expect_text(HEAD POINTS "property list quad int w\n" END, "no type 'quad'");
    expect_text(HEAD POINTS "property list float int w\n" END, "length of list 'w' is no integer");
    expect_text(HEAD POINTS "property list uchar int\n" END, "line 7 of the header");
    expect_text(HEAD POINTS "surprise 5\n" END, "begins with 'surprise'");
    expect_text(HEAD FACES END "3 0 0 0\n3 0 0 0\n", "its vertices have no 'x'");
    expect_text(HEAD "element vertex 1\nproperty int x\nproperty int y\n" FACES END, "its vertices have no 'z'");
    expect_text(HEAD "element vertex 1\nproperty int x\nproperty int y\nproperty list uchar int z\n" FACES END,
                "its vertices have no 'z'");
    expect_text(HEAD POINTS "element face 1\nproperty list uchar int corners\n" END, "'vertex_indices'");
    expect_text(HEAD POINTS "element face 1\nproperty int vertex_indices\n" END, "'vertex_indices'");
}

static void test_limits(void **state)
{
    (void)state;
    static char text[200000];
    size_t size = (size_t)sprintf(text, HEAD "element vertex 1\n");
    for (int i = 0; i < 1025; i++)
        size += (size_t)sprintf(text + size, "property float p%d\n", i);
    expect_text(text, "more than 1024 properties");
    size = (size_t)sprintf(text, HEAD);
    for (int i = 0; i < 65; i++)
        size += (size_t)sprintf(text + size, "element e%d 1\n", i);
    expect_text(text, "more than 64 elements");
    size = (size_t)sprintf(text, HEAD "element ");
    memset(text + size, 'e', 100);
    strcpy(text + size + 100, " 5\n");
    expect_text(text, "name of more than 63 characters");
    memset(text + size, 'e', 100000);
    strcpy(text + size + 100000, " 5\n");
    expect_text(text, "line 3 of the header is too long");
    size = (size_t)sprintf(text, "%s", HEAD POINTS FACES END "0 0 0\n1 0 0\n0 1 ");
    memset(text + size, '0', 100000);
    strcpy(text + size + 100000, "\n3 0 1 2\n");
    expect_text(text, "vertex 2, in line 12, has a value that is not a number");
}

static void test_bodies(void **state)
{
    (void)state;
    expect_text(HEAD POINTS END ROWS, "point cloud of 3 vertices");
    expect_text(HEAD POINTS "element face 0\nproperty list uchar int vertex_indices\n" END ROWS, "point cloud");
    expect_text(HEAD POINTS FACES END ROWS "2 0 1\n0\n", "only 0 points, 1 lines and 1 empty faces");
    expect_text(HEAD POINTS FACES END ROWS "3 0 1 2\n3 0 1 3\n",
                "corner 2 of face 1 is vertex 3, but there are only 3");
    expect_text(HEAD POINTS FACES END ROWS "3 0 -1 2\n3 0 1 2\n", "corner 1 of face 0 is vertex -1");
    expect_text(HEAD POINTS FACES END ROWS "3 0 1.5 2\n3 0 1 2\n", "face 0, in line 13, has a value that is not a");
    expect_text(HEAD POINTS FACES END ROWS "3 0 x 2\n3 0 1 2\n", "face 0, in line 13, has a value that is not a");
    expect_text(HEAD POINTS FACES END ROWS "-3 0 1 2\n3 0 1 2\n", "list 'vertex_indices' of -3 values");
    expect_text(HEAD POINTS FACES END ROWS "200 0 1 2\n3 0 1 2\n", "list 'vertex_indices' of 200 values");
    expect_text(HEAD POINTS FACES END ROWS "3 0 1 2 7\n3 0 1 2\n", "face 0, in line 13, has more values");
    expect_text(HEAD POINTS FACES END "0 0 0 7\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 2\n", "vertex 0, in line 10, has more");
    expect_text(HEAD POINTS FACES END "0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 2\n", "vertex 0, in line 11, has more");
    expect_text(HEAD POINTS FACES END ROWS "3 0 1 2\n", "cut off in face 1 of 2");
    expect_text(HEAD "element vertex 9999999\nproperty int x\nproperty int y\nproperty int z\n" FACES END ROWS,
                "9999999 rows of 'vertex', but the file has room for 3 at most");
    expect_text(HEAD
                "element vertex 999999999999999999\nproperty int x\nproperty int y\nproperty int z\n" FACES END ROWS,
                "999999999999999999 rows of 'vertex'");
}

/* A file that ends early is refused, but in text the last number may be shorter and the last line may have no end. */
static void test_truncated(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < PLY_FILE_SAMPLES; i++) {
        struct ply_file file;
        struct ply_expected expected;
        ply_file_sample(i, &file, &expected);
        assert_int_equal(read_any(file.bytes, file.size), BVHD_OK);
        size_t last = file.size - 2;
        while (file.format == 0 && file.bytes[last] != ' ')
            last--;
        for (size_t size = 1; size < file.size; size++) {
            enum bvhd_status status = read_any(file.bytes, size);
            assert_true(status || (file.format == 0 && size > last));
        }
    }
}

static void test_mutations(void **state)
{
    (void)state;
    struct random random = {7};
    for (int run = 0; run < 60000; run++) {
        struct ply_file file;
        struct ply_expected expected;
        ply_file_sample((uint32_t)run % PLY_FILE_SAMPLES, &file, &expected);
        for (uint64_t steps = 1 + random_next(&random) % 4; steps; steps--) {
            size_t at = random_next(&random) % file.size;
            uint64_t value = random_next(&random);
            file.bytes[at] =
                value % 3 ? (unsigned char)(value >> 8) : (unsigned char)("0123456789- \n."[value / 3 % 14]);
            if (value % 7 == 0)
                file.size = at + 1;
        }
        read_any(file.bytes, file.size);
    }
}

static void test_no_memory(void **state)
{
    (void)state;
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t after = 0; status; after++) {
        struct ply_file file;
        struct ply_expected expected;
        struct memory memory;
        struct import import;
        ply_file_sample(4, &file, &expected);
        memory_init(&memory, UINT64_MAX);
        atomic_store(&memory.fail_after, after);
        status = read_bytes(file.bytes, file.size, &memory, &import, NULL);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        if (!status)
            import_finish(&import);
        assert_int_equal(memory.live, 0);
        assert_true(after < 50);
    }
}

/* A file that cannot be read to its end, or at other places. */
struct stream {
    const char *bytes;
    size_t size, at;
    bool has_seek;
};

static ssize_t read_stream(void *cookie, char *buffer, size_t size)
{
    struct stream *stream = cookie;
    size_t left = stream->size - stream->at, got = size < left ? size : left;
    if (left == 0)
        return -1;
    memcpy(buffer, stream->bytes + stream->at, got);
    stream->at += got;
    return (ssize_t)got;
}

static int seek_stream(void *cookie, off64_t *offset, int whence)
{
    struct stream *stream = cookie;
    if (!stream->has_seek || whence != SEEK_SET || *offset > (off64_t)stream->size)
        return -1;
    stream->at = (size_t)*offset;
    return 0;
}

/* Reads a stream of which `size` bytes are said to be there. */
static void expect_stream(struct stream stream, uint64_t size, enum bvhd_status expected, const char *text)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    FILE *file = fopencookie(&stream, "rb", (cookie_io_functions_t){.read = read_stream, .seek = seek_stream});
    assert_non_null(file);
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(ply_import_stream(file, size, "x.ply", &no_points, &memory, &import, &error), expected);
    if (!strstr(error.text, text))
        fail_msg("'%s' instead of '%s'", error.text, text);
    fclose(file);
    assert_int_equal(memory.live, 0);
}

#define LIST "property list uchar int vertex_indices\n"
#define TRIANGLE "0 0 0\n1 0 0\n0 1 0\n"

static void test_streams(void **state)
{
    (void)state;
    static const char whole[] = HEAD POINTS "element face 1\n" LIST "end_header\n" TRIANGLE "3 0 1 2\n";
    static const char late[] = HEAD "element face 1\n" LIST POINTS "end_header\n3 0 1 2\n" TRIANGLE;
    static const char cut[] =
        "ply\nformat binary_little_endian 1.0\n" POINTS "element face 1\n" LIST "end_header\n1234";
    expect_stream((struct stream){whole, sizeof whole - 1, 0, true}, sizeof whole - 1, BVHD_IO, "it cannot be read");
    expect_stream((struct stream){late, sizeof late - 1, 0, false}, sizeof late - 1, BVHD_IO,
                  "it cannot be read twice");
    expect_stream((struct stream){cut, sizeof cut - 1, 0, true}, sizeof cut + 100, BVHD_INVALID, "vertex 0");
}

/* Files with more vertices or faces than numbers of 32 bits count. They would be some 60 GB large. */
static void test_huge_counts(void **state)
{
    (void)state;
    static const char vertices[] = "ply\nformat binary_little_endian 1.0\nelement vertex 4294967295\nproperty float x\n"
                                   "property float y\nproperty float z\nelement face 1\n" LIST "end_header\n";
    static const char faces[] = "ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\n"
                                "property float y\nproperty float z\nelement face 1431655766\n" LIST "end_header\n";
    expect_stream((struct stream){vertices, sizeof vertices - 1, 0, true}, UINT64_C(1) << 40, BVHD_UNSUPPORTED,
                  "more than 4294967294 vertices");
    expect_stream((struct stream){faces, sizeof faces - 1, 0, true}, UINT64_C(1) << 40, BVHD_UNSUPPORTED,
                  "more than 1431655765 triangles");
}

/* Names have a limit, and numbers of rows digits. */
static void test_long_words(void **state)
{
    (void)state;
    char text[1000];
    snprintf(text, sizeof text, HEAD "element vertex 3\nproperty float %0300d\nend_header\n", 0);
    expect_text(text, "more than 63 characters");
    snprintf(text, sizeof text, HEAD "element vertex %019d\n", 1);
    expect_text(text, "");
}

/* Skipping beyond the end of a file fails, as reading there does. */
static void test_skipping(void **state)
{
    (void)state;
    static struct ply_source source;
    char bytes[] = "0123456789";
    FILE *file = fmemopen(bytes, 10, "rb");
    assert_non_null(file);
    ply_source_init(&source, file, 10);
    assert_false(ply_source_skip(&source, 11));
    assert_false(ply_source_seek(&source, 11, 1));
    assert_true(ply_source_skip(&source, 10));
    assert_int_equal(ply_source_left(&source), 0);
    source.format = PLY_LITTLE_ENDIAN;
    assert_false(ply_source_skip_values(&source, PLY_FLOAT64, 1));
    fclose(file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_headers),    cmocka_unit_test(test_limits),      cmocka_unit_test(test_bodies),
        cmocka_unit_test(test_truncated),  cmocka_unit_test(test_mutations),   cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_streams),    cmocka_unit_test(test_huge_counts), cmocka_unit_test(test_skipping),
        cmocka_unit_test(test_long_words),
    };
    return cmocka_run_group_tests_name("ply_broken", tests, NULL, NULL);
}
