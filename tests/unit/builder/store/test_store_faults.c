/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_store_faults.c - tests that each system call of the store may fail, one after the other, by every reason that
 * matters: entries are read as they are or not at all, nothing is left over, and all is well when the reason has gone.
 * The linker puts the functions below between the store and the C library (--wrap, in meson.build).
 */
#include "tests/support/unit.h"

#include <dirent.h>
#include <errno.h>
#include <ftw.h>
#include <sys/file.h>
#include <sys/statvfs.h>

#include "tests/support/open_descriptors.h"
#include "tests/support/scratch.h"

#include "tests/support/builder/store_bed.h"

enum { SIZE = 70000, ROUNDS_MOST = 1000 };

/* The call after `after` further ones fails with `number`, and with `again` those behind it, too. */
static struct {
    bool on, again, hit;
    int after, number;
    bool writes_only; /* only calls that need room on the disk count and fail */
    bool short_io; /* every other read or write moves one byte */
    bool can_do_less; /* there are neither reservations nor locks */
    uint32_t calls;
} fault;

static bool fails(bool needs_room)
{
    if (!fault.on || (fault.writes_only && !needs_room) || fault.after-- > 0)
        return false;
    fault.after = fault.again ? 0 : ROUNDS_MOST * ROUNDS_MOST;
    fault.hit = true;
    errno = fault.number;
    return true;
}

/* WRAP(name of the function, whether it needs room, the result of a failure, type, parameters, arguments) */
#define WRAP(name, room, failure, type, parameters, arguments)                                                         \
    type __real_##name parameters;                                                                                     \
    type __wrap_##name parameters;                                                                                     \
    type __wrap_##name parameters                                                                                      \
    {                                                                                                                  \
        return fails(room) ? failure : __real_##name arguments;                                                        \
    }

WRAP(fdatasync, true, -1, int, (int file), (file))
WRAP(fsync, true, -1, int, (int file), (file))
WRAP(mkdirat, true, -1, int, (int folder, const char *name, mode_t mode), (folder, name, mode))
WRAP(renameat, true, -1, int, (int a, const char *from, int b, const char *to), (a, from, b, to))
WRAP(unlinkat, false, -1, int, (int folder, const char *name, int flags), (folder, name, flags))
WRAP(futimens, false, -1, int, (int file, const struct timespec times[2]), (file, times))
WRAP(fdopendir, false, NULL, DIR *, (int folder), (folder))
WRAP(getrandom, false, -1, ssize_t, (void *bytes, size_t size, unsigned flags), (bytes, size, flags))
WRAP(fstatat64, false, -1, int, (int folder, const char *name, struct stat *about, int flags),
     (folder, name, about, flags))
WRAP(fstat64, false, -1, int, (int file, struct stat *about), (file, about))
WRAP(statvfs64, false, -1, int, (const char *path, struct statvfs *about), (path, about))
WRAP(readdir64, false, NULL, struct dirent *, (DIR * folder), (folder))

int __real_fallocate64(int file, int mode, off_t at, off_t size);
int __wrap_fallocate64(int file, int mode, off_t at, off_t size);
int __wrap_fallocate64(int file, int mode, off_t at, off_t size)
{
    errno = EOPNOTSUPP;
    return fault.can_do_less || fails(true) ? -1 : __real_fallocate64(file, mode, at, size);
}

int __real_flock(int file, int operation);
int __wrap_flock(int file, int operation);
int __wrap_flock(int file, int operation)
{
    errno = ENOLCK;
    return fault.can_do_less || fails(false) ? -1 : __real_flock(file, operation);
}

ssize_t __real_pwrite64(int file, const void *bytes, size_t size, off_t at);
ssize_t __wrap_pwrite64(int file, const void *bytes, size_t size, off_t at);
ssize_t __wrap_pwrite64(int file, const void *bytes, size_t size, off_t at)
{
    bool is_short = fault.short_io && size > 1 && fault.calls++ % 2;
    return fails(true) ? -1 : __real_pwrite64(file, bytes, is_short ? 1 : size, at);
}

ssize_t __real_pread64(int file, void *bytes, size_t size, off_t at);
ssize_t __wrap_pread64(int file, void *bytes, size_t size, off_t at);
ssize_t __wrap_pread64(int file, void *bytes, size_t size, off_t at)
{
    bool is_short = fault.short_io && size > 1 && fault.calls++ % 2;
    return fails(false) ? -1 : __real_pread64(file, bytes, is_short ? 1 : size, at);
}

int __real_openat64(int folder, const char *name, int flags, mode_t mode);
int __wrap_openat64(int folder, const char *name, int flags, mode_t mode);
int __wrap_openat64(int folder, const char *name, int flags, mode_t mode)
{
    return fails(flags & O_CREAT) ? -1 : __real_openat64(folder, name, flags, mode);
}

int __real_open64(const char *name, int flags, mode_t mode);
int __wrap_open64(const char *name, int flags, mode_t mode);
int __wrap_open64(const char *name, int flags, mode_t mode)
{
    return fails(false) ? -1 : __real_open64(name, flags, mode);
}

/* What is tried under faults. Each returns the status of the call. */
static enum bvhd_status try_put(struct bvhd_error *error)
{
    return bed_try_put(2, SIZE, error);
}

static enum bvhd_status try_replace(struct bvhd_error *error)
{
    return bed_try_put(1, SIZE, error);
}

static enum bvhd_status try_get(struct bvhd_error *error)
{
    return bed_get(1, error);
}

static enum bvhd_status try_scan(struct bvhd_error *error)
{
    return store_scan(bed_store, error);
}

static enum bvhd_status try_trim(struct bvhd_error *error)
{
    return store_trim_to(bed_store, 0, error);
}

static enum bvhd_status try_clear(struct bvhd_error *error)
{
    return store_clear(bed_store, error);
}

static enum bvhd_status try_damaged(struct bvhd_error *error)
{
    enum bvhd_status status = bed_get(3, error);
    assert_int_not_equal(status, BVHD_OK);
    return status == BVHD_NOT_FOUND ? BVHD_OK : status;
}

/* Entry 1 is whole, and 3 is damaged. A put of entry 2 has to make its folder. */
static void prepare(void)
{
    struct bvhd_error error = {0};
    assert_int_equal(store_clear(bed_store, &error), BVHD_OK);
    bed_put(1, SIZE);
    bed_put(3, 100);
    bed_age(1, 1000);
    int file = bed_file(3, O_RDWR);
    assert_int_equal(ftruncate(file, 90), 0);
    close(file);
}

static uint32_t files, unfinished; /* what count_files has counted */

static int count_one(const char *path, const struct stat *about, int kind, struct FTW *place)
{
    (void)about, (void)place;
    files += kind == FTW_F && !strstr(path, STORE_DAMAGED);
    unfinished += kind == FTW_F && strstr(path, STORE_TEMPORARY);
    return 0;
}

static void count_files(void)
{
    files = unfinished = 0;
    assert_int_equal(nftw(store_directory(bed_store), count_one, 8, FTW_PHYS), 0);
}

/* When the fault has gone, all works, and whatever was left over goes by a scan. */
static void expect_well(void)
{
    struct bvhd_error error = {0};
    (void)bed_has(2); /* whole, or not there */
    assert_false(bed_has(3));
    for (uint32_t i = 1; i <= 3; i++) {
        bed_put(i, SIZE);
        assert_true(bed_has(i));
    }
    assert_int_equal(store_scan(bed_store, &error), BVHD_OK);
    assert_int_equal(store_state(bed_store).entries, 3);
    count_files();
    assert_int_equal(files, 4); /* with the tag */
}

/* Lets the first, second, ... call fail until `try` is through without a failure. Returns how many there were. */
static int run_faults(enum bvhd_status (*try)(struct bvhd_error *), int number, bool writes_only, bool again)
{
    for (int after = 0; after < ROUNDS_MOST; after++) {
        struct bvhd_error error = {0};
        prepare();
        uint32_t before = open_descriptors();
        memset(&fault, 0, sizeof fault);
        fault.writes_only = writes_only;
        fault.again = again;
        fault.after = after;
        fault.number = number;
        fault.on = true;
        enum bvhd_status status = try(&error);
        fault.on = false;
        assert_int_equal(open_descriptors(), before);
        if (!fault.hit) {
            assert_int_equal(status, BVHD_OK);
            return after;
        }
        assert_true(status == BVHD_OK || (error.status == status && error.text[0]));
        count_files();
        if (writes_only)
            assert_true(unfinished == 0 && bed_has(1));
        expect_well();
    }
    fail();
    return 0;
}

static void every_call_may_fail(void **state)
{
    (void)state;
    static enum bvhd_status (*const tries[])(struct bvhd_error *) = {try_put,  try_replace, try_get,    try_scan,
                                                                     try_trim, try_clear,   try_damaged};
    static const int numbers[] = {EIO, EMFILE, EACCES, ENOENT, EINTR};
    for (size_t i = 0; i < sizeof tries / sizeof tries[0]; i++)
        for (size_t k = 0; k < sizeof numbers / sizeof numbers[0]; k++) {
            assert_true(run_faults(tries[i], numbers[k], false, false) > 2);
            if (numbers[k] != EINTR)
                run_faults(tries[i], numbers[k], false, true);
        }
}

/* Hits go on while the disk is full, from every write on, and nothing is left of what could not be written. */
static void a_full_disk_loses_nothing(void **state)
{
    (void)state;
    static const int numbers[] = {ENOSPC, EDQUOT, EFBIG};
    for (int i = 0; i < 3; i++) {
        assert_true(run_faults(try_put, numbers[i], true, true) > 5);
        assert_true(run_faults(try_put, numbers[i], true, false) > 5);
        assert_true(run_faults(try_replace, numbers[i], true, true) > 3);
        assert_true(run_faults(try_damaged, numbers[i], true, true) > 0);
        run_faults(try_get, numbers[i], true, true);
    }
}

static void reads_and_writes_may_be_short(void **state)
{
    (void)state;
    fault.short_io = true;
    for (uint32_t i = 0; i < 4; i++)
        bed_put(i, 30 * i * i * i);
    bed_put(4, 70000);
    for (uint32_t i = 0; i < 5; i++)
        assert_true(bed_has(i));
    fault.short_io = false;
    for (uint32_t i = 0; i < 5; i++)
        assert_true(bed_has(i));
}

static void some_file_systems_can_do_less(void **state)
{
    (void)state;
    fault.can_do_less = true;
    bed_put(1, SIZE);
    assert_true(bed_has(1));
    fault.can_do_less = false;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(every_call_may_fail, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(a_full_disk_loses_nothing, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(reads_and_writes_may_be_short, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(some_file_systems_can_do_less, bed_begin, bed_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
