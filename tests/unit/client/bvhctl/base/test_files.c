/* SPDX-License-Identifier: Apache-2.0 */
/* test_files.c - tests that files are read and written completely or not at all. */
#include "tests/support/unit.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/bvhctl/base/depfile.h"
#include "client/bvhctl/base/files.h"
#include "tests/support/scratch.h"

static struct bytes text_bytes(const char *text)
{
    return (struct bytes){(const unsigned char *)text, strlen(text)};
}

static void write_text(const char *path, const char *text, bool expect_change)
{
    struct memory memory;
    bool changed;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(files_write(path, text_bytes(text), &memory, &changed, NULL), BVHD_OK);
    assert_int_equal(changed, expect_change);
    assert_int_equal(memory.live, 0);
}

static void expect_text(const char *path, const char *text)
{
    struct memory memory;
    unsigned char *data;
    uint64_t size;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(files_read(path, 1 << 20, &memory, &data, &size, NULL), BVHD_OK);
    assert_int_equal(size, strlen(text));
    if (size)
        assert_memory_equal(data, text, size);
    memory_free(&memory, data);
    assert_int_equal(memory.live, 0);
}

static unsigned count_entries(void)
{
    unsigned count = 0;
    DIR *list = opendir(".");
    while (readdir(list))
        count++;
    closedir(list);
    return count - 2;
}

static void test_write_and_read(void **state)
{
    (void)state;
    write_text("one", "first", true);
    expect_text("one", "first");
    write_text("one", "second and longer", true);
    expect_text("one", "second and longer");
    write_text("one", "", true);
    expect_text("one", "");
    assert_int_equal(count_entries(), 1);
    unlink("one");
}

static void test_unchanged_keeps_time(void **state)
{
    (void)state;
    write_text("same", "content", true);
    struct timespec old[2] = {{.tv_sec = 1000000}, {.tv_sec = 1000000}};
    assert_int_equal(utimensat(AT_FDCWD, "same", old, 0), 0);
    struct stat before, after;
    stat("same", &before);
    write_text("same", "content", false);
    stat("same", &after);
    assert_int_equal(after.st_mtime, 1000000);
    assert_int_equal(after.st_ino, before.st_ino);
    write_text("same", "contenT", true);
    stat("same", &after);
    assert_true(after.st_mtime > 1000000);
    unlink("same");
}

/* A difference at the very end of a file that is compared in chunks is found. */
static void test_large_content(void **state)
{
    (void)state;
    enum { SIZE = 3 * 65536 + 17 };
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    unsigned char *data = calloc(1, SIZE);
    bool changed;
    assert_int_equal(files_write("large", (struct bytes){data, SIZE}, &memory, &changed, NULL), BVHD_OK);
    data[SIZE - 1] = 1;
    assert_int_equal(files_write("large", (struct bytes){data, SIZE}, &memory, &changed, NULL), BVHD_OK);
    assert_true(changed);
    assert_int_equal(files_write("large", (struct bytes){data, SIZE}, &memory, &changed, NULL), BVHD_OK);
    assert_false(changed);
    free(data);
    unlink("large");
}

static void test_mode_follows_umask(void **state)
{
    (void)state;
    mode_t old = umask(027);
    write_text("mode", "x", true);
    umask(old);
    struct stat status;
    stat("mode", &status);
    assert_int_equal(status.st_mode & 0777, 0640);
    unlink("mode");
}

static void expect_read_failure(const char *path, uint64_t limit, enum bvhd_status expected)
{
    struct memory memory;
    struct bvhd_error error = {0};
    unsigned char *data = NULL;
    uint64_t size = 77;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(files_read(path, limit, &memory, &data, &size, &error), expected);
    assert_int_equal(error.status, expected);
    assert_string_equal(error.where, path);
    assert_int_equal(size, 77);
    assert_int_equal(memory.live, 0);
}

static void test_read_failures(void **state)
{
    (void)state;
    expect_read_failure("missing", 10, BVHD_NOT_FOUND);
    expect_read_failure(".", 10, BVHD_IO);
    assert_int_equal(mkfifo("pipe", 0600), 0);
    expect_read_failure("pipe", 10, BVHD_IO);
    write_text("eleven", "12345678901", true);
    expect_read_failure("eleven", 10, BVHD_TOO_LARGE);
    unlink("pipe");
    unlink("eleven");
}

static void test_failed_write_leaves_nothing(void **state)
{
    (void)state;
    struct memory memory;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(files_write("no/such/place", text_bytes("x"), &memory, NULL, &error), BVHD_NOT_FOUND);
    assert_string_equal(error.where, "no/such/place");
    mkdir("taken", 0777);
    mkdir("taken/inside", 0777);
    assert_int_equal(files_write("taken", text_bytes("x"), &memory, NULL, &error), BVHD_IO);
    assert_int_equal(count_entries(), 1);
    rmdir("taken/inside");
    rmdir("taken");
    atomic_store(&memory.fail_after, 0);
    assert_int_equal(files_write("fresh", text_bytes("x"), &memory, NULL, &error), BVHD_NO_MEMORY);
    assert_int_equal(count_entries(), 0);
    assert_int_equal(memory.live, 0);
}

static void test_links_stay(void **state)
{
    (void)state;
    assert_int_equal(mkdir("far", 0777), 0);
    write_text("far/target", "old", true);
    assert_int_equal(symlink("far/target", "near"), 0);
    assert_int_equal(symlink("near", "nearer"), 0);
    write_text("nearer", "old", false);
    write_text("nearer", "new", true);
    expect_text("far/target", "new");
    struct stat status;
    assert_int_equal(lstat("nearer", &status), 0);
    assert_true(S_ISLNK(status.st_mode));
    assert_int_equal(lstat("near", &status), 0);
    assert_true(S_ISLNK(status.st_mode));
    assert_int_equal(count_entries(), 3);
    unlink("nearer");
    unlink("near");
    unlink("far/target");
    rmdir("far");
}

static void expect_write_failure(const char *path, enum bvhd_status expected)
{
    struct memory memory;
    struct bvhd_error error = {0};
    struct stat before, after;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(lstat(path, &before), 0);
    assert_int_equal(files_write(path, text_bytes("x"), &memory, NULL, &error), expected);
    assert_string_equal(error.where, path);
    assert_int_equal(lstat(path, &after), 0);
    assert_int_equal(before.st_ino, after.st_ino);
    assert_int_equal(before.st_mode, after.st_mode);
    assert_int_equal(memory.live, 0);
}

/* A pipe, as an example of anything that is neither a file nor a directory, is not replaced. */
static void test_only_files_are_replaced(void **state)
{
    (void)state;
    assert_int_equal(mkfifo("pipe", 0600), 0);
    assert_int_equal(symlink("pipe", "to-pipe"), 0);
    assert_int_equal(symlink("nothing", "to-nothing"), 0);
    assert_int_equal(symlink("round", "round"), 0);
    assert_int_equal(mkdir("empty", 0777), 0);
    expect_write_failure("pipe", BVHD_IO);
    expect_write_failure("to-pipe", BVHD_IO);
    expect_write_failure("to-nothing", BVHD_NOT_FOUND);
    expect_write_failure("round", BVHD_IO);
    expect_write_failure("empty", BVHD_IO);
    assert_int_equal(count_entries(), 5);
    unlink("pipe");
    unlink("to-pipe");
    unlink("to-nothing");
    unlink("round");
    rmdir("empty");
}

static void expect_join(const char *directory_name, const char *expected)
{
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    char *path = files_join(&memory, directory_name, "name");
    assert_string_equal(path, expected);
    memory_free(&memory, path);
    assert_int_equal(memory.live, 0);
}

static void test_join(void **state)
{
    (void)state;
    expect_join("a", "a/name");
    expect_join("a/b", "a/b/name");
    expect_join("a/", "a/name");
    expect_join("a//", "a/name");
    expect_join("/", "/name");
    expect_join("./", "./name");
}

static void test_make_directory(void **state)
{
    (void)state;
    struct bvhd_error error;
    assert_int_equal(files_make_directory("a/b//c/", &error), BVHD_OK);
    assert_true(files_is_directory("a/b/c"));
    assert_int_equal(files_make_directory("a/b/c", &error), BVHD_OK);
    write_text("a/file", "x", true);
    assert_int_equal(files_make_directory("a/file", &error), BVHD_IO);
    assert_int_equal(files_make_directory("a/file/more", &error), BVHD_IO);
    assert_int_equal(files_make_directory("", &error), BVHD_IO);
    unlink("a/file");
    rmdir("a/b/c");
    rmdir("a/b");
    rmdir("a");
}

static void write_rule(const char *target, const char *path, const char *expected)
{
    struct memory memory;
    struct depfile depfile;
    memory_init(&memory, UINT64_MAX);
    depfile_init(&depfile, &memory, target);
    depfile_add(&depfile, path);
    depfile_add(&depfile, "last");
    assert_int_equal(depfile_write(&depfile, "rule.d", NULL), BVHD_OK);
    depfile_finish(&depfile);
    depfile_finish(&depfile);
    expect_text("rule.d", expected);
    unlink("rule.d");
    assert_int_equal(memory.live, 0);
}

static void test_depfile(void **state)
{
    (void)state;
    write_rule("out/manifest.json", "scene.obj", "out/manifest.json: \\\n  scene.obj \\\n  last\n");
    write_rule("o t", "a b#c$d", "o\\ t: \\\n  a\\ b\\#c$$d \\\n  last\n");
    write_rule("t", "a\\b", "t: \\\n  a\\b \\\n  last\n");
    write_rule("t", "a\\ b", "t: \\\n  a\\\\\\ b \\\n  last\n");
}

static void test_depfile_no_memory(void **state)
{
    (void)state;
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t after = 0; status != BVHD_OK; after++) {
        struct memory memory;
        struct depfile depfile;
        struct bvhd_error error = {0};
        memory_init(&memory, UINT64_MAX);
        atomic_store(&memory.fail_after, after);
        depfile_init(&depfile, &memory, "target");
        depfile_add(&depfile, "path");
        status = depfile_write(&depfile, "rule.d", &error);
        depfile_finish(&depfile);
        assert_int_equal(memory.live, 0);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        assert_int_equal(count_entries(), status != BVHD_OK ? 0 : 1);
        assert_true(after < 20);
    }
    unlink("rule.d");
    depfile_finish(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_write_and_read),          cmocka_unit_test(test_unchanged_keeps_time),
        cmocka_unit_test(test_large_content),           cmocka_unit_test(test_mode_follows_umask),
        cmocka_unit_test(test_read_failures),           cmocka_unit_test(test_failed_write_leaves_nothing),
        cmocka_unit_test(test_make_directory),          cmocka_unit_test(test_depfile),
        cmocka_unit_test(test_depfile_no_memory),       cmocka_unit_test(test_links_stay),
        cmocka_unit_test(test_only_files_are_replaced), cmocka_unit_test(test_join),
    };
    return cmocka_run_group_tests_name("files", tests, scratch_enter, scratch_remove);
}
