/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_output.c - tests that what a build writes, as a directory and as a container, is read again, and that a failure
 * leaves nothing behind.
 */
#include "tests/support/unit.h"

#include <unistd.h>

#include "client/bvhctl/scene/output.h"
#include "client/bvhctl/scene/structures.h"
#include "tests/support/client/bvhctl/test_world.h"
#include "tests/support/scratch.h"

static struct test_world world;

static int begin(void **state)
{
    test_world_init(&world, 1);
    return scratch_enter(state);
}

static int end(void **state)
{
    test_world_finish(&world);
    return scratch_remove(state);
}

static void endings(void **state)
{
    (void)state;
    assert_true(output_is_container("a.bvhd"));
    assert_true(output_is_container("dir/a.b.bvhd"));
    assert_false(output_is_container(".bvhd"));
    assert_false(output_is_container("dir/.bvhd"));
    assert_false(output_is_container("a.bvhd/"));
    assert_false(output_is_container("bvhd"));
    assert_false(output_is_container("a.BVHD"));
}

/* Writes the world, with its manifest. */
static enum bvhd_status write_world(const char *path, struct memory *memory, struct output *output,
                                    struct bvhd_error *error)
{
    struct file_names names;
    struct json manifest, scenes;
    enum bvhd_status status = output_open(output, path, memory, error);
    if (status != BVHD_OK)
        return status;
    assert_int_equal(file_names_make(&world.import, &names, NULL), BVHD_OK);
    json_init(&manifest, world.import.memory, true);
    json_init(&scenes, world.import.memory, true);
    manifest_begin(&manifest, &world.options);
    for (uint32_t i = 0; i < names.count && status == BVHD_OK; i++) {
        status = output_put(output, &world.assembly, i, &names, error);
        manifest_write_structure(&manifest, &world.assembly, i, &names, false);
    }
    manifest_end(&manifest, &scenes);
    assert_false(manifest.failed);
    if (status == BVHD_OK)
        status = output_end(output, (struct bytes){(unsigned char *)manifest.data, manifest.size}, true, error);
    json_finish(&scenes);
    json_finish(&manifest);
    file_names_finish(&names);
    return status;
}

/* Expects that what was written has the bytes of the world, and can be traced. */
static void expect_world(const char *path)
{
    struct memory memory;
    struct structures structures;
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    if (structures_open(path, NULL, &memory, &structures, &error) != BVHD_OK)
        fail_msg("%s: %s: %s", path, error.where, error.text);
    assert_int_equal(structures.file_count, TEST_WORLD_FILES);
    for (uint32_t i = 0; i < TEST_WORLD_FILES; i++) {
        assert_int_equal(structures.blobs[i].size, world.assembly.items[i].size);
        assert_memory_equal(structures.blobs[i].data, world.assembly.items[i].data, structures.blobs[i].size);
    }
    structures_close(&structures);
    assert_int_equal(memory.live, 0);
}

static void written_and_read(const char *path, uint32_t files)
{
    struct memory memory;
    struct output output;
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    for (int round = 0; round < 2; round++) {
        if (write_world(path, &memory, &output, &error) != BVHD_OK)
            fail_msg("%s: %s", error.where, error.text);
        assert_int_equal(output.changed, round ? 0 : files);
        assert_int_equal(output.removed, 0);
        output_close(&output);
        output_close(&output);
        expect_world(path);
        assert_int_equal(memory.live, 0);
    }
}

static void a_directory(void **state)
{
    (void)state;
    written_and_read("directory", TEST_WORLD_FILES);
}

static void a_container(void **state)
{
    (void)state;
    written_and_read("world.bvhd", 1);
}

/* A container that is not complete is not written, and its temporary file is removed. */
static void an_incomplete_container(void **state)
{
    struct memory memory;
    struct output output;
    (void)state;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(output_open(&output, "part.bvhd", &memory, NULL), BVHD_OK);
    assert_int_equal(output_end(&output, (struct bytes){NULL, 0}, false, NULL), BVHD_OK);
    output_close(&output);
    assert_int_not_equal(access("part.bvhd", F_OK), 0);
    assert_int_not_equal(system("ls part.bvhd.* >/dev/null 2>&1"), 0);
    assert_int_equal(memory.live, 0);
}

static void without_memory(void **state)
{
    static const char *const paths[] = {"failing", "failing.bvhd"};
    (void)state;
    for (int i = 0; i < 2; i++) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        for (int64_t n = 0; status != BVHD_OK; n++) {
            struct memory memory;
            struct output output = {0};
            memory_init(&memory, UINT64_MAX);
            memory.fail_after = n;
            status = write_world(paths[i], &memory, &output, NULL);
            output_close(&output);
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            assert_int_equal(memory.live, 0);
            assert_true(n < 1000);
        }
        expect_world(paths[i]);
    }
}

static void read_without_memory(void **state)
{
    static const char *const paths[] = {"directory", "world.bvhd"};
    (void)state;
    for (int i = 0; i < 2; i++) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        for (int64_t n = 0; status != BVHD_OK; n++) {
            struct memory memory;
            struct manifest manifest;
            memory_init(&memory, UINT64_MAX);
            memory.fail_after = n;
            status = manifest_read(paths[i], &memory, &manifest, NULL);
            if (status == BVHD_OK)
                manifest_finish(&manifest);
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            assert_int_equal(memory.live, 0);
            assert_true(n < 1000);
        }
    }
}

/* A container whose manifest names a structure that it does not have. */
static void a_structure_that_is_missing(void **state)
{
    struct memory memory;
    struct built built;
    struct built_bytes bytes;
    struct bvhd_error error;
    (void)state;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(built_open("world.bvhd", &memory, &built, &error), BVHD_OK);
    assert_int_equal(built_read(&built, "world.none.as", &bytes, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "world.bvhd");
    assert_int_equal(built_read(&built, "", &bytes, &error), BVHD_CORRUPT);
    assert_int_equal(built_read(&built, "zzz", &bytes, &error), BVHD_CORRUPT);
    assert_int_equal(built_read(&built, "world.tlas.as", &bytes, &error), BVHD_OK);
    assert_null(bytes.owned);
    built_close(&built);
    built_close(&built);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(endings),
        cmocka_unit_test(a_directory),
        cmocka_unit_test(a_container),
        cmocka_unit_test(an_incomplete_container),
        cmocka_unit_test(without_memory),
        cmocka_unit_test(read_without_memory),
        cmocka_unit_test(a_structure_that_is_missing),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
