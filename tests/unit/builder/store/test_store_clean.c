/* SPDX-License-Identifier: Apache-2.0 */
/* test_store_clean.c - tests counting, trimming and clearing, and what they leave alone. */
#include "tests/support/unit.h"

#include <sys/file.h>

#include "tests/support/scratch.h"

#include "tests/support/builder/store_bed.h"

enum { PAGE = 4096, SMALL = 3000 /* takes a page */ };

/* Makes an entry that was used so many seconds ago. */
static void put_aged(uint32_t number, int64_t age)
{
    bed_put(number, SMALL);
    bed_age(number, age);
}

static void scan(void)
{
    struct bvhd_error error = {0};
    assert_int_equal(store_scan(bed_store, &error), BVHD_OK);
}

static void expect_holds(uint64_t entries, uint64_t bytes)
{
    struct store_state at = store_state(bed_store);
    assert_int_equal(at.entries, entries);
    assert_int_equal(at.bytes, bytes);
}

static void a_scan_counts_all_generations(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    char path[96];
    bed_put(1, SMALL);
    bed_put(2, 2 * PAGE);
    bed_close();
    snprintf(path, sizeof path, "%s/cache", scratch_folder);
    bed_open_with(path, "release-9", 1000000, 0);
    assert_false(bed_has(1));
    bed_put(3, SMALL);
    scan();
    assert_true(store_state(bed_store).counted);
    expect_holds(3, 5 * PAGE);
    assert_int_equal(store_clear(bed_store, &error), BVHD_OK);
    expect_holds(0, 0);
    assert_int_equal(bed_shell(0, "find . | wc -l"), 2);
    bed_put(1, SMALL);
    assert_true(bed_has(1));
}

static void a_trim_removes_the_oldest(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    for (uint32_t i = 0; i < 30; i++)
        put_aged(i, 1000 + (i * 7) % 30);
    assert_int_equal(store_trim(bed_store, &error), BVHD_OK);
    expect_holds(30, 30 * PAGE);
    assert_int_equal(store_trim_to(bed_store, 10 * PAGE + 1, &error), BVHD_OK);
    expect_holds(10, 10 * PAGE);
    for (uint32_t i = 0; i < 30; i++)
        assert_int_equal(bed_has(i), (i * 7) % 30 < 10);
    assert_int_equal(store_state(bed_store).evicted, 20);
    assert_int_equal(store_trim_to(bed_store, 0, &error), BVHD_OK);
    expect_holds(0, 0);
}

/* An entry that was used is younger than others that were written later. */
static void what_was_used_stays(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    put_aged(1, 5000);
    put_aged(2, 4000);
    put_aged(3, 3000);
    assert_true(bed_has(1));
    assert_int_equal(store_trim_to(bed_store, PAGE, &error), BVHD_OK);
    assert_true(bed_has(1) && !bed_has(2) && !bed_has(3));
}

/* Times of a clock that was wrong do not keep an entry. */
static void times_in_the_future_are_old(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    put_aged(1, -1000000);
    put_aged(2, -2000000);
    put_aged(3, 5000);
    put_aged(4, -INT64_C(5000000000));
    assert_int_equal(store_trim_to(bed_store, 2 * PAGE, &error), BVHD_OK);
    assert_true(!bed_has(1) && bed_has(3));
    put_aged(5, 1);
    assert_int_equal(store_trim_to(bed_store, 2 * PAGE, &error), BVHD_OK);
    assert_true(bed_has(3) && bed_has(5));
}

/* More files than the list of the oldest ones holds. */
static void many_files_are_trimmed(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    bed_shell(0, "mkdir -p release-1/00 && cd release-1/00 && seq -f %064g 10000 29999 | xargs touch && "
                 "for i in *; do echo >$i; done");
    bed_put(1, SMALL);
    scan();
    expect_holds(20001, 20001 * PAGE);
    assert_int_equal(store_trim_to(bed_store, 50 * PAGE, &error), BVHD_OK);
    expect_holds(50, 50 * PAGE);
    assert_true(bed_has(1));
}

static void a_full_store_makes_room(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    bed_close();
    bed_open(100 * PAGE);
    for (uint32_t i = 0; i < 100; i++)
        put_aged(i, 10000 - (long)i);
    expect_holds(100, 100 * PAGE);
    scan();
    bed_put(100, SMALL);
    expect_holds(90, 90 * PAGE);
    assert_true(!bed_has(10) && bed_has(11) && bed_has(99) && bed_has(100));
    assert_int_equal(bed_try_put(200, 100 * PAGE / 8 + 1, &error), BVHD_TOO_LARGE);
    assert_int_equal(store_state(bed_store).write_errors, 1);
}

/* Processes that write little and end keep a directory near its budget, too. */
static void short_lives_stay_near_the_budget(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 400; i++) {
        bed_close();
        bed_open(160 * PAGE);
        for (uint32_t k = 0; k < 4; k++)
            bed_put(4 * i + k, SMALL);
    }
    assert_true(bed_files() <= 2 * 160);
}

static void another_process_may_write_and_remove(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    struct store *first = bed_store;
    bed_open(100 * PAGE);
    scan();
    struct store *second = bed_store;
    for (uint32_t i = 0; i < 20; i++) {
        bed_store = i % 2 ? first : second;
        bed_put(i / 2, SMALL);
    }
    bed_store = second;
    scan();
    expect_holds(10, 10 * PAGE);
    assert_int_equal(store_clear(first, &error), BVHD_OK);
    expect_holds(10, 10 * PAGE);
    assert_false(bed_has(1));
    assert_int_equal(store_trim_to(second, 0, &error), BVHD_OK);
    expect_holds(0, 0);
    bed_put(1, SMALL);
    store_close(first);
}

/* Two stores of the same budget write in turn, and each counts again before the directory is far over it. */
static void a_shared_directory_stays_near_its_budget(void **state)
{
    (void)state;
    bed_close();
    struct store *stores[2];
    for (int i = 0; i < 2; i++) {
        bed_open(160 * PAGE);
        scan();
        stores[i] = bed_store;
    }
    for (uint32_t i = 0; i < 400; i++) {
        bed_store = stores[i % 2];
        bed_put(i, SMALL);
        if (i % 20 == 0)
            assert_true(bed_files() <= 160 + 2 * 11);
    }
    store_close(stores[0]);
}

static void a_short_file_system_makes_room(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    char path[96];
    for (uint32_t i = 0; i < 10; i++)
        bed_put(i, SMALL);
    bed_close();
    snprintf(path, sizeof path, "%s/cache", scratch_folder);
    bed_open_with(path, "development-test1", 1000000, UINT64_C(1) << 62);
    assert_true(store_needs_trim(bed_store));
    assert_int_equal(bed_try_put(20, SMALL, &error), BVHD_IO);
    assert_non_null(strstr(error.text, "stay free"));
    expect_holds(0, 0);
    assert_int_equal(bed_files(), 0);
    assert_false(store_needs_trim(bed_store));
}

static void left_over_files_go(void **state)
{
    (void)state;
    bed_put(1, SMALL);
    bed_put(2, SMALL);
    int held = bed_file(2, O_RDWR);
    assert_int_equal(flock(held, LOCK_EX), 0);
    bed_shell(2, "mv $E ${E%/*}/.new-2 && touch ${E%/*}/.new-1");
    scan();
    assert_int_equal(bed_files(), 2);
    expect_holds(1, PAGE);
    close(held);
    scan();
    assert_int_equal(bed_files(), 1);
}

static void other_files_stay(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    bed_put(1, SMALL);
    bed_shell(1, "N=$(printf %064d 1) && "
                 "mkdir -p ab other/ab release-1/abc release-1/damaged/sub release- development-/ab && "
                 "touch $N ab/$N other/ab/$N release-1/$N release-1/abc/$N release-1/damaged/letter ${E%/*}/letter "
                 "development-/ab/$N");
    assert_int_equal(bed_files(), 9);
    assert_int_equal(store_clear(bed_store, &error), BVHD_OK);
    assert_int_equal(bed_files(), 8);
    assert_int_equal(bed_shell(0, "find . -mindepth 1 -type d | wc -l"), 12);
}

static void a_cancelled_walk_says_so(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    bed_put(1, SMALL);
    atomic_store(&bed_cancel, true);
    assert_int_equal(store_scan(bed_store, &error), BVHD_CANCELLED);
    assert_int_equal(store_trim_to(bed_store, 0, &error), BVHD_CANCELLED);
    assert_int_equal(store_clear(bed_store, &error), BVHD_CANCELLED);
    assert_true(bed_has(1));
}

static void a_removed_directory_comes_back(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    bed_put(1, SMALL);
    bed_shell(0, "rm -rf ../cache");
    assert_false(bed_has(1));
    assert_int_equal(store_scan(bed_store, &error), BVHD_OK);
    expect_holds(0, 0);
    bed_put(1, SMALL);
    assert_true(bed_has(1));
}

static enum bvhd_status try_open(const char *directory, const char *generation, struct bvhd_error *error)
{
    struct store_options options = {directory, generation, 1000000, STORE_KEEP_FREE_DEFAULT, NULL};
    struct store *store = NULL;
    *error = (struct bvhd_error){0};
    enum bvhd_status status = store_open(&options, &bed_memory, &store, error);
    store_close(store);
    assert_true(status == BVHD_OK || (error->status == status && error->text[0]));
    return status;
}

static void directories_that_are_not_safe_are_refused(void **state)
{
    (void)state;
    struct bvhd_error error;
    char path[PATH_MAX + 8];
    static const char *const generations[] = {"", "release-", "release-A", "release-1/..", "..", "test", "release-1.2"};
    snprintf(path, sizeof path, "%s/a/b//c", scratch_folder);
    assert_int_equal(try_open(path, "release-1", &error), BVHD_OK);
    for (size_t i = 0; i < sizeof generations / sizeof generations[0]; i++)
        assert_int_equal(try_open(path, generations[i], &error), BVHD_INVALID);
    assert_int_equal(chmod(path, 0777), 0);
    assert_int_equal(try_open(path, "release-1", &error), BVHD_INVALID);
    assert_non_null(strstr(error.text, "others may write"));
    snprintf(path, sizeof path, "%s/a/file", scratch_folder);
    close(open(path, O_CREAT | O_RDWR, 0600));
    assert_int_equal(try_open(path, "release-1", &error), BVHD_INVALID);
    strcat(path, "/below");
    assert_int_equal(try_open(path, "release-1", &error), BVHD_IO);
    assert_int_equal(try_open("", "release-1", &error), BVHD_INVALID);
    memset(path, 'x', PATH_MAX);
    path[PATH_MAX] = '\0';
    assert_int_equal(try_open(path, "release-1", &error), BVHD_INVALID);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, bed_begin, bed_end)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(a_scan_counts_all_generations),
        TEST(a_trim_removes_the_oldest),
        TEST(what_was_used_stays),
        TEST(times_in_the_future_are_old),
        TEST(many_files_are_trimmed),
        TEST(a_full_store_makes_room),
        TEST(short_lives_stay_near_the_budget),
        TEST(another_process_may_write_and_remove),
        TEST(a_shared_directory_stays_near_its_budget),
        TEST(a_short_file_system_makes_room),
        TEST(left_over_files_go),
        TEST(other_files_stay),
        TEST(a_cancelled_walk_says_so),
        TEST(a_removed_directory_comes_back),
        TEST(directories_that_are_not_safe_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
