/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_container.c - tests that containers are read as they were written, that their bytes stay those of the golden
 * file, and that damaged and hostile ones are refused with a place.
 *
 * With BVHD_WRITE_GOLDEN=1 in the environment the golden file is written instead of compared.
 */
#include "tests/support/unit.h"

#include "builder/format/container_internal.h"
#include "builder/format/serialized.h"
#include "tests/support/builder/test_container.h"

static struct bytes made;

static int make(void **state)
{
    (void)state;
    made = test_container_make();
    return 0;
}

static int drop(void **state)
{
    (void)state;
    free((void *)(uintptr_t)made.data);
    return 0;
}

/* A copy that a test changes. */
static unsigned char *copy_container(void)
{
    unsigned char *copy = aligned_alloc(CONTAINER_ALIGN, bytes_align(made.size, CONTAINER_ALIGN));
    assert_non_null(copy);
    memcpy(copy, made.data, made.size);
    return copy;
}

static unsigned char *row_of(unsigned char *file, uint32_t row)
{
    return file + bytes_get64(file + HEADER_DIRECTORY) + (uint64_t)row * CONTAINER_ROW;
}

/* Makes the directory's checksum right again after a change. */
static void seal(unsigned char *file, uint64_t size)
{
    uint64_t directory = bytes_get64(file + HEADER_DIRECTORY);
    const uint64_t sizes[] = {(uint64_t)bytes_get32(file + HEADER_COUNT) * CONTAINER_ROW,
                              4 * bytes_get64(file + HEADER_REFERENCES), bytes_get64(file + HEADER_TEXTS),
                              bytes_get64(file + HEADER_MANIFEST), 1};
    uint64_t sum = container_header_seed(file), at = directory;
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; at += sizes[i++]) {
        if (sizes[i] > size || at > size - sizes[i])
            return;
        sum = checksum((struct bytes){file + at, sizes[i]}, sum);
    }
    bytes_put64(file + HEADER_CHECKSUM, sum);
}

/* Expects that a changed container is refused at a place that ends with `where`. */
static void expect_refusal(unsigned char *file, uint64_t size, const char *where)
{
    struct container container;
    struct bvhd_error error = {0};
    seal(file, size);
    enum bvhd_status status = container_open((struct bytes){file, size}, &container, &error);
    size_t length = strlen(error.where), wanted = strlen(where);
    if (status == BVHD_OK || length < wanted || strcmp(error.where + length - wanted, where) != 0 || !error.text[0])
        fail_msg("%s: %d, %s: %s", where, status, error.where, error.text);
}

static void it_is_read_as_written(void **state)
{
    struct container container;
    struct bvhd_error error;
    (void)state;
    assert_true(container_is(made));
    assert_int_equal(container_open(made, &container, &error), BVHD_OK);
    assert_int_equal(container.count, TEST_CONTAINER_ROWS);
    assert_int_equal(container.version, 1);
    assert_string_equal((const char *)container.manifest.data, TEST_CONTAINER_MANIFEST);
    for (uint32_t i = 0; i < container.count; i++) {
        struct container_structure row = container_structure(&container, i);
        uint32_t stored = i == 1 ? 0 : i;
        char file[32];
        snprintf(file, sizeof file, "%s.%u.as", i < 4 ? "one" : "two", i);
        assert_string_equal(row.file, file);
        assert_string_equal(row.scene, i < 4 ? "one" : "two");
        assert_int_equal(row.type, i == 3 || i == 5 ? STRUCTURE_TOP : STRUCTURE_BOTTOM);
        assert_int_equal(row.target, TARGET_PORTABLE);
        assert_int_equal(row.key.bytes[31], 0x10 + stored);
        assert_int_equal(row.blob.size, TEST_CONTAINER_SIZE + 8 * stored);
        assert_int_equal((uintptr_t)row.blob.data % CONTAINER_ALIGN, 0);
        assert_true(row.bounds[0] == -1 && row.bounds[5] == 3.5f + (float)i);
        assert_true(row.slabs[0] == -4 && row.slabs[19] == 4);
        assert_int_equal(container_check(&container, i, &error), BVHD_OK);
    }
    struct container_structure top = container_structure(&container, 3);
    assert_int_equal(top.reference_count, 2);
    assert_int_equal(top.references[0], 2);
    assert_int_equal(top.references[1], 0);
    assert_ptr_equal(container_structure(&container, 0).blob.data, container_structure(&container, 1).blob.data);
    assert_string_equal(container_structure(&container, 4).name, "");
}

static FILE *open_golden(const char *mode)
{
    char path[4096];
    const char *directory = getenv("BVHD_GOLDEN");
    snprintf(path, sizeof path, "%s/container-v1.hex", directory ? directory : "tests/golden");
    FILE *file = fopen(path, mode);
    assert_non_null(file);
    return file;
}

static void its_bytes_stay(void **state)
{
    unsigned byte;
    uint64_t count = 0;
    (void)state;
    if (getenv("BVHD_WRITE_GOLDEN")) {
        FILE *file = open_golden("w");
        for (uint64_t i = 0; i < made.size; i++)
            fprintf(file, "%02x%s", made.data[i], i % 16 == 15 || i + 1 == made.size ? "\n" : " ");
        fclose(file);
    }
    FILE *file = open_golden("r");
    for (; fscanf(file, "%2x", &byte) == 1; count++)
        if (count >= made.size || made.data[count] != byte)
            fail_msg("byte %llu differs from the golden %02x", (unsigned long long)count, byte);
    fclose(file);
    assert_int_equal(count, made.size);
}

/* Every prefix lies in a block of its own size, so that a sanitizer sees each byte that is read behind it. */
static void every_truncation_is_refused(void **state)
{
    (void)state;
    for (uint64_t size = 0; size < made.size; size++) {
        void *block = NULL;
        struct container container;
        struct bvhd_error error = {0};
        assert_int_equal(posix_memalign(&block, CONTAINER_ALIGN, size ? size : 1), 0);
        memcpy(block, made.data, size);
        if (container_open((struct bytes){block, size}, &container, &error) != BVHD_CORRUPT || !error.where[0])
            fail_msg("%llu bytes: %s: %s", (unsigned long long)size, error.where, error.text);
        free(block);
    }
}

static void a_byte_too_many_is_refused(void **state)
{
    unsigned char *copy = aligned_alloc(CONTAINER_ALIGN, bytes_align(made.size + 1, CONTAINER_ALIGN));
    struct container container;
    struct bvhd_error error;
    (void)state;
    assert_non_null(copy);
    memcpy(copy, made.data, made.size);
    copy[made.size] = 0;
    assert_int_equal(container_open((struct bytes){copy, made.size + 1}, &container, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "container.size");
    free(copy);
}

static bool is_found(struct bytes file)
{
    struct container container;
    if (container_open(file, &container, NULL) != BVHD_OK)
        return true;
    for (uint32_t i = 0; i < container.count; i++)
        if (container_check(&container, i, NULL) != BVHD_OK)
            return true;
    return false;
}

static void every_bit_flip_is_found(void **state)
{
    unsigned char *copy = copy_container();
    (void)state;
    for (uint64_t bit = 0; bit < 8 * made.size; bit++) {
        copy[bit / 8] ^= (unsigned char)(1u << bit % 8);
        if (!is_found((struct bytes){copy, made.size}))
            fail_msg("bit %llu of byte %llu", (unsigned long long)(bit % 8), (unsigned long long)(bit / 8));
        copy[bit / 8] ^= (unsigned char)(1u << bit % 8);
    }
    assert_false(is_found((struct bytes){copy, made.size}));
    free(copy);
}

static void other_versions_are_refused(void **state)
{
    unsigned char *copy = copy_container();
    struct container container;
    struct bvhd_error error;
    (void)state;
    for (uint32_t version = 0; version < 4; version += 2) {
        bytes_put32(copy + HEADER_VERSION, version);
        seal(copy, made.size);
        assert_int_equal(container_open((struct bytes){copy, made.size}, &container, &error), BVHD_INCOMPATIBLE);
        assert_string_equal(error.where, "container.version");
    }
    memcpy(copy, "bvhdSCEN", 8);
    assert_false(container_is((struct bytes){copy, made.size}));
    expect_refusal(copy, made.size, "container");
    free(copy);
}

/* Field `offset` of the header or of a row gets a value, with a right checksum. */
static void with_header(uint32_t offset, uint64_t value, const char *where)
{
    unsigned char *copy = copy_container();
    bytes_put64(copy + offset, value);
    expect_refusal(copy, made.size, where);
    free(copy);
}

static void with_row32(uint32_t row, uint32_t offset, uint32_t value, const char *where)
{
    unsigned char *copy = copy_container();
    bytes_put32(row_of(copy, row) + offset, value);
    expect_refusal(copy, made.size, where);
    free(copy);
}

static void with_row64(uint32_t row, uint32_t offset, uint64_t value, const char *where)
{
    unsigned char *copy = copy_container();
    bytes_put64(row_of(copy, row) + offset, value);
    expect_refusal(copy, made.size, where);
    free(copy);
}

static void hostile_headers_are_refused(void **state)
{
    (void)state;
    uint64_t directory = bytes_get64(made.data + HEADER_DIRECTORY);
    with_header(HEADER_SIZE, made.size + 1, "container.size");
    with_header(HEADER_DIRECTORY, 0, "container.directory");
    with_header(HEADER_DIRECTORY, directory + 1, "container.directory");
    with_header(HEADER_DIRECTORY, directory + 64, "container.directory");
    with_header(HEADER_DIRECTORY, UINT64_MAX - 63, "container.directory");
    with_header(HEADER_REFERENCES, UINT64_MAX / 4, "container.directory");
    with_header(HEADER_REFERENCES, UINT64_MAX / 4 + 4, "container.directory");
    with_header(HEADER_TEXTS, UINT64_MAX, "container.directory");
    with_header(HEADER_TEXTS, 0, "container.directory");
    with_header(HEADER_MANIFEST, UINT64_MAX, "container.directory");
    with_header(HEADER_MANIFEST, UINT64_MAX - made.size, "container.directory");
    unsigned char *copy = copy_container();
    bytes_put32(copy + HEADER_COUNT, UINT32_MAX);
    expect_refusal(copy, made.size, "container.directory");
    free(copy);
}

static void overlapping_places_are_refused(void **state)
{
    (void)state;
    uint64_t first = bytes_get64(row_of((unsigned char *)(uintptr_t)made.data, 0) + ROW_OFFSET);
    assert_int_equal(first, CONTAINER_HEADER);
    with_row64(2, ROW_OFFSET, first, "structures[2].offset");
    with_row64(2, ROW_OFFSET, first + 1, "structures[2].offset");
    with_row64(0, ROW_OFFSET, 0, "structures[0].offset");
    with_row64(0, ROW_OFFSET, UINT64_MAX - 63, "structures[0].offset");
    with_row64(0, ROW_SIZE, UINT64_MAX, "structures[0].size");
    with_row64(0, ROW_SIZE, UINT64_MAX - 63, "structures[0].size");
    with_row64(0, ROW_SIZE, made.size, "structures[0].size");
    with_row64(0, ROW_SIZE, TEST_CONTAINER_SIZE + 1, "structures[0].size");
    with_row64(0, ROW_SIZE, 0, "structures[0].size");
    with_row32(2, ROW_STORED, 3, "structures[2].stored");
    with_row32(2, ROW_STORED, 0, "structures[2].stored");
    with_row32(1, ROW_STORED, 1, "structures[1].offset");
    with_row32(0, ROW_STORED, UINT32_MAX, "structures[0].stored");
    with_row32(1, ROW_TARGET, TARGET_LAVAPIPE, "structures[1].stored");
}

static void wrong_rows_are_refused(void **state)
{
    (void)state;
    with_row32(0, ROW_TYPE, 2, "structures[0].type");
    with_row32(4, ROW_TARGET, 3, "structures[4].target");
    with_row32(4, ROW_TARGET, TARGET_LAVAPIPE, "structures[5].references");
    with_row32(3, ROW_REFERENCE_COUNT, 3, "structures[3].references");
    with_row32(3, ROW_REFERENCE_COUNT, 1, "structures[4].references");
    with_row32(3, ROW_REFERENCE_COUNT, UINT32_MAX, "structures[3].references");
    with_row32(3, ROW_FIRST_REFERENCE, 1, "structures[3].references");
    with_row32(3, ROW_TYPE, STRUCTURE_BOTTOM, "structures[3].references");
    with_row32(5, ROW_REFERENCE_COUNT, 0, "container.references");
    with_row32(0, ROW_FILE, 0, "structures[0].file");
    with_row32(0, ROW_FILE, UINT32_MAX, "structures[0].file");
    with_row32(1, ROW_NAME, 0, "structures[1].name");
    with_row32(4, ROW_SCENE, 0, "structures[4].file");
    with_row32(4, ROW_SCENE, 4, "structures[4].scene");
    with_row32(0, ROW_SCENE, 1, "structures[0].scene");
    unsigned char *copy = copy_container();
    unsigned char *references = row_of(copy, TEST_CONTAINER_ROWS);
    bytes_put32(references, 3);
    expect_refusal(copy, made.size, "structures[3].references");
    bytes_put32(references, UINT32_MAX);
    expect_refusal(copy, made.size, "structures[3].references");
    free(copy);
}

static void wrong_texts_are_refused(void **state)
{
    (void)state;
    static const char *const names[] = {"a/b", ".\0\0", "..\0", "\xc3(a", "\0ab"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        unsigned char *copy = copy_container();
        unsigned char *texts = row_of(copy, TEST_CONTAINER_ROWS) + 4 * bytes_get64(copy + HEADER_REFERENCES);
        memcpy(texts + bytes_get32(row_of(copy, 0) + ROW_FILE), names[i], 3);
        expect_refusal(copy, made.size, i == 1 || i == 3 ? "" : "structures[0].file");
        free(copy);
    }
    unsigned char *copy = copy_container();
    copy[made.size - 1] = 'x';
    expect_refusal(copy, made.size, "container.manifest");
    copy[made.size - 1] = copy[made.size - 2] = 0;
    expect_refusal(copy, made.size, "container.manifest");
    free(copy);
    copy = copy_container();
    bytes_put64(copy + HEADER_TEXTS, bytes_get64(copy + HEADER_TEXTS) - 1);
    bytes_put64(copy + HEADER_MANIFEST, bytes_get64(copy + HEADER_MANIFEST) + 1);
    expect_refusal(copy, made.size, "container.texts");
    free(copy);
}

static void padding_is_zero(void **state)
{
    (void)state;
    uint64_t directory = bytes_get64(made.data + HEADER_DIRECTORY);
    unsigned char *copy = copy_container();
    copy[CONTAINER_HEADER + TEST_CONTAINER_SIZE] = 1;
    expect_refusal(copy, made.size, "structures[2].offset");
    copy[CONTAINER_HEADER + TEST_CONTAINER_SIZE] = 0;
    copy[directory - 1] = 1;
    expect_refusal(copy, made.size, "container.directory");
    free(copy);
}

/* Moves what follows the structures 64 bytes further. */
static void nothing_is_between_structures_and_directory(void **state)
{
    (void)state;
    uint64_t directory = bytes_get64(made.data + HEADER_DIRECTORY), size = made.size + CONTAINER_ALIGN;
    unsigned char *copy = aligned_alloc(CONTAINER_ALIGN, bytes_align(size, CONTAINER_ALIGN));
    assert_non_null(copy);
    memcpy(copy, made.data, directory);
    memset(copy + directory, 0, CONTAINER_ALIGN);
    memcpy(copy + directory + CONTAINER_ALIGN, made.data + directory, made.size - directory);
    bytes_put64(copy + HEADER_DIRECTORY, directory + CONTAINER_ALIGN);
    bytes_put64(copy + HEADER_SIZE, size);
    expect_refusal(copy, size, "container.directory");
    free(copy);
}

static void failures_leave_nothing_behind(void **state)
{
    struct memory memory;
    struct bvhd_error error;
    enum bvhd_status status = BVHD_NO_MEMORY;
    (void)state;
    for (int64_t n = 0; status != BVHD_OK; n++) {
        memory_init(&memory, UINT64_MAX);
        memory.fail_after = n;
        struct test_sink sink = {.memory = &memory, .fail_after = -1};
        status = test_container_write(&memory, &sink, &error);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY || status == BVHD_IO);
        memory_free(&memory, sink.data);
        assert_int_equal(memory.live, 0);
        assert_true(n < 1000);
    }
    status = BVHD_IO;
    memory_init(&memory, UINT64_MAX);
    for (int64_t n = 0; status != BVHD_OK; n++) {
        struct test_sink sink = {.memory = &memory, .fail_after = n};
        status = test_container_write(&memory, &sink, &error);
        assert_true(status == BVHD_OK || status == BVHD_IO);
        memory_free(&memory, sink.data);
        assert_int_equal(memory.live, 0);
        assert_true(n < 1000);
    }
}

/* More structures than the first size of the table of keys. */
static void many_structures(void **state)
{
    enum { COUNT = 300 };
    struct memory memory;
    struct container_writer writer;
    struct container container;
    struct bvhd_error error;
    unsigned char blob[SERIALIZED_HANDLES] = {0}, header[CONTAINER_HEADER];
    (void)state;
    memory_init(&memory, UINT64_MAX);
    struct test_sink sink = {.memory = &memory, .fail_after = -1};
    serialized_write(blob, &(struct serialized_header){.serialized_size = sizeof blob});
    container_writer_init(&writer, &memory, test_sink_take, &sink);
    for (uint32_t i = 0; i < COUNT; i++) {
        char file[16];
        snprintf(file, sizeof file, "%u", i);
        struct container_structure structure = {.blob = {blob, sizeof blob},
                                                .type = STRUCTURE_BOTTOM,
                                                .target = TARGET_PORTABLE,
                                                .file = file,
                                                .name = "",
                                                .scene = "s"};
        bytes_put32(structure.key.bytes, i % 100);
        assert_int_equal(container_writer_add(&writer, &structure, &error), BVHD_OK);
    }
    assert_int_equal(container_writer_end(&writer, (struct bytes){NULL, 0}, header, &error), BVHD_OK);
    memcpy(sink.data, header, sizeof header);
    assert_int_equal(container_open((struct bytes){sink.data, sink.size}, &container, &error), BVHD_OK);
    assert_int_equal(container.count, COUNT);
    assert_int_equal(bytes_get64(sink.data + HEADER_DIRECTORY), CONTAINER_HEADER + 100 * 64);
    assert_ptr_equal(container_structure(&container, 299).blob.data, container_structure(&container, 99).blob.data);
    container_writer_finish(&writer);
    container_writer_finish(&writer);
    memory_free(&memory, sink.data);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_is_read_as_written),
        cmocka_unit_test(its_bytes_stay),
        cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(a_byte_too_many_is_refused),
        cmocka_unit_test(every_bit_flip_is_found),
        cmocka_unit_test(other_versions_are_refused),
        cmocka_unit_test(hostile_headers_are_refused),
        cmocka_unit_test(overlapping_places_are_refused),
        cmocka_unit_test(wrong_rows_are_refused),
        cmocka_unit_test(wrong_texts_are_refused),
        cmocka_unit_test(padding_is_zero),
        cmocka_unit_test(nothing_is_between_structures_and_directory),
        cmocka_unit_test(failures_leave_nothing_behind),
        cmocka_unit_test(many_structures),
    };
    return cmocka_run_group_tests(tests, make, drop);
}
