/* SPDX-License-Identifier: Apache-2.0 */
/* test_scene_file.c - tests that programs get from a container what is in it, and refusals for everything else. */
#include "tests/support/unit.h"

#include <bvhd/bvhd_scene.h>
#include <errno.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include "client/library.h"
#include "tests/support/builder/test_container.h"
#include "tests/support/scratch.h"

static struct bytes made;

static int make(void **state)
{
    made = test_container_make();
    return scratch_enter(state);
}

static int drop(void **state)
{
    free((void *)(uintptr_t)made.data);
    return scratch_remove(state);
}

static void write_file(const char *path, struct bytes content)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(content.data, 1, content.size, file), content.size);
    assert_int_equal(fclose(file), 0);
}

static void expect_content(const struct bvhd_scene *scene)
{
    uint64_t size;
    assert_int_equal(bvhd_scene_structure_count(scene), TEST_CONTAINER_ROWS);
    assert_int_equal(bvhd_scene_top_count(scene), 2);
    assert_int_equal(bvhd_scene_top(scene, 0), 3);
    assert_int_equal(bvhd_scene_top(scene, 1), 5);
    assert_int_equal(bvhd_scene_top(scene, 2), UINT32_MAX);
    assert_int_equal(bvhd_scene_find_top(scene, "two"), 5);
    assert_int_equal(bvhd_scene_find_top(scene, "three"), UINT32_MAX);
    assert_int_equal(bvhd_scene_find(scene, "one.2.as"), 2);
    assert_int_equal(bvhd_scene_find(scene, "one.5.as"), UINT32_MAX);
    assert_null(bvhd_scene_get_structure(scene, TEST_CONTAINER_ROWS));
    assert_string_equal(bvhd_scene_manifest(scene, &size), TEST_CONTAINER_MANIFEST);
    assert_int_equal(size, strlen(TEST_CONTAINER_MANIFEST));
    assert_non_null(bvhd_scene_manifest(scene, NULL));
    const struct bvhd_scene_structure *top = bvhd_scene_get_structure(scene, 3);
    assert_int_equal(top->type, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
    assert_int_equal(top->target, BVHD_TARGET_PORTABLE);
    assert_int_equal(top->bottom_count, 2);
    assert_int_equal(top->bottoms[0], 2);
    assert_int_equal(top->bottoms[1], 0);
    assert_int_equal(top->key.bytes[0], 0x13);
    assert_true(top->bounds[0] == -1 && top->bounds[5] == 6.5f && top->slabs[0] == -4 && top->slabs[19] == 4);
    assert_int_equal((uintptr_t)top->data % 64, 0);
    assert_int_equal(top->size, TEST_CONTAINER_SIZE + 24);
    assert_string_equal(top->scene, "one");
    for (uint32_t i = 0; i < TEST_CONTAINER_ROWS; i++)
        assert_int_equal(bvhd_scene_check(scene, i, NULL), BVHD_OK);
}

static void from_a_file(void **state)
{
    struct bvhd_scene *scene = NULL;
    struct bvhd_error error;
    (void)state;
    write_file("good.bvhd", made);
    assert_int_equal(bvhd_scene_open("good.bvhd", 0, &scene, &error), BVHD_OK);
    expect_content(scene);
    bvhd_scene_close(scene);
    bvhd_scene_close(NULL);
    assert_int_equal(library_memory.live, 0);
}

static void from_bytes(void **state)
{
    struct bvhd_scene *scene = NULL;
    (void)state;
    assert_int_equal(bvhd_scene_open_bytes(made.data, made.size, 0, &scene, NULL), BVHD_OK);
    expect_content(scene);
    bvhd_scene_close(scene);
}

static void arguments_are_checked(void **state)
{
    struct bvhd_scene *scene = NULL;
    struct bvhd_error error;
    (void)state;
    assert_int_equal(bvhd_scene_open(NULL, 0, &scene, &error), BVHD_INVALID);
    assert_string_equal(error.where, "path");
    assert_int_equal(bvhd_scene_open("good.bvhd", 0, NULL, &error), BVHD_INVALID);
    assert_string_equal(error.where, "ret_scene");
    assert_int_equal(bvhd_scene_open("good.bvhd", 2, &scene, &error), BVHD_INVALID);
    assert_string_equal(error.where, "flags");
    assert_int_equal(bvhd_scene_open_bytes(NULL, 64, 0, &scene, &error), BVHD_INVALID);
    assert_int_equal(bvhd_scene_open_bytes(made.data, made.size, 0, NULL, &error), BVHD_INVALID);
    assert_int_equal(bvhd_scene_open_bytes(made.data, made.size, 8, &scene, &error), BVHD_INVALID);
    assert_int_equal(bvhd_scene_open_bytes(made.data + 1, made.size - 1, 0, &scene, &error), BVHD_INVALID);
    assert_string_equal(error.where, "data");
    assert_int_equal(bvhd_scene_open_bytes(made.data, 0, 0, &scene, &error), BVHD_CORRUPT);
    assert_null(scene);
    assert_int_equal(bvhd_scene_open_bytes(made.data, made.size, 0, &scene, NULL), BVHD_OK);
    assert_int_equal(bvhd_scene_check(scene, TEST_CONTAINER_ROWS, &error), BVHD_INVALID);
    assert_string_equal(error.where, "index");
    bvhd_scene_close(scene);
}

static void other_files_are_refused(void **state)
{
    struct bvhd_scene *scene = NULL;
    struct bvhd_error error;
    (void)state;
    assert_int_equal(bvhd_scene_open("none.bvhd", 0, &scene, &error), BVHD_NOT_FOUND);
    assert_string_equal(error.where, "none.bvhd");
    assert_int_equal(bvhd_scene_open(".", 0, &scene, &error), BVHD_IO);
    assert_int_equal(mkfifo("pipe.bvhd", 0600), 0);
    assert_int_equal(bvhd_scene_open("pipe.bvhd", 0, &scene, &error), BVHD_IO);
    assert_string_equal(error.text, "not a regular file");
    write_file("empty.bvhd", (struct bytes){made.data, 0});
    assert_int_equal(bvhd_scene_open("empty.bvhd", 0, &scene, &error), BVHD_CORRUPT);
    write_file("short.bvhd", (struct bytes){made.data, made.size - 1});
    assert_int_equal(bvhd_scene_open("short.bvhd", 0, &scene, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "container.size");
    assert_null(scene);
    assert_int_equal(library_memory.live, 0);
}

static void damage_is_found_at_once_or_later(void **state)
{
    struct bvhd_scene *scene = NULL;
    struct bvhd_error error;
    unsigned char *copy = aligned_alloc(64, bytes_align(made.size, 64));
    (void)state;
    assert_non_null(copy);
    memcpy(copy, made.data, made.size);
    copy[CONTAINER_HEADER + 40] ^= 1; /* the deserialized size of structure 0, which nothing but its checksum guards */
    assert_int_equal(bvhd_scene_open_bytes(copy, made.size, 0, &scene, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "container.structures[0].checksum");
    assert_int_equal(bvhd_scene_open_bytes(copy, made.size, BVHD_SCENE_LAZY, &scene, &error), BVHD_OK);
    assert_int_equal(bvhd_scene_check(scene, 2, &error), BVHD_OK);
    assert_int_equal(bvhd_scene_check(scene, 1, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "container.structures[1].checksum");
    bvhd_scene_close(scene);
    free(copy);
}

/* The numbers of errors that the next calls fail with; 0: they do not. */
static int fstat_error, mmap_error;

int __wrap_fstat64(int descriptor, struct stat64 *ret_status);
int __real_fstat64(int descriptor, struct stat64 *ret_status);
void *__wrap_mmap64(void *at, size_t size, int access, int flags, int descriptor, off64_t offset);
void *__real_mmap64(void *at, size_t size, int access, int flags, int descriptor, off64_t offset);

int __wrap_fstat64(int descriptor, struct stat64 *ret_status)
{
    errno = fstat_error;
    return fstat_error ? -1 : __real_fstat64(descriptor, ret_status);
}

void *__wrap_mmap64(void *at, size_t size, int access, int flags, int descriptor, off64_t offset)
{
    errno = mmap_error;
    return mmap_error ? MAP_FAILED : __real_mmap64(at, size, access, flags, descriptor, offset);
}

static void expect_status(enum bvhd_status expected)
{
    struct bvhd_scene *scene = NULL;
    struct bvhd_error error = {0};
    assert_int_equal(bvhd_scene_open("good.bvhd", 0, &scene, &error), expected);
    if (expected != BVHD_OK)
        assert_string_equal(error.where, "good.bvhd");
    assert_null(bvhd_scene_get_structure(NULL, 0));
    assert_int_equal(bvhd_scene_find(scene, NULL), UINT32_MAX);
    assert_int_equal(bvhd_scene_find_top(scene, NULL), UINT32_MAX);
    bvhd_scene_close(scene);
    assert_int_equal(library_memory.live, 0);
}

static void calls_that_fail_are_reported(void **state)
{
    (void)state;
    write_file("good.bvhd", made);
    expect_status(BVHD_OK);
    fstat_error = EIO;
    expect_status(BVHD_IO);
    fstat_error = 0;
    mmap_error = ENOMEM;
    expect_status(BVHD_NO_MEMORY);
    mmap_error = EACCES;
    expect_status(BVHD_IO);
    mmap_error = 0;
    struct bvhd_scene *scene = NULL;
    library_memory.fail_after = 0;
    assert_int_equal(bvhd_scene_open_bytes(made.data, made.size, 0, &scene, NULL), BVHD_NO_MEMORY);
    library_memory.fail_after = -1;
    expect_status(BVHD_OK);
}

static void without_memory(void **state)
{
    enum bvhd_status status = BVHD_NO_MEMORY;
    (void)state;
    write_file("good.bvhd", made);
    for (int64_t n = 0; status != BVHD_OK; n++) {
        struct bvhd_scene *scene = NULL;
        library_memory.fail_after = n;
        status = bvhd_scene_open("good.bvhd", 0, &scene, NULL);
        library_memory.fail_after = -1;
        assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && !scene));
        bvhd_scene_close(scene);
        assert_int_equal(library_memory.live, 0);
        assert_true(n < 10);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(from_a_file),
        cmocka_unit_test(from_bytes),
        cmocka_unit_test(arguments_are_checked),
        cmocka_unit_test(other_files_are_refused),
        cmocka_unit_test(damage_is_found_at_once_or_later),
        cmocka_unit_test(calls_that_fail_are_reported),
        cmocka_unit_test(without_memory),
    };
    return cmocka_run_group_tests(tests, make, drop);
}
