/* SPDX-License-Identifier: Apache-2.0 */
/* test_store.c - tests that entries come back as they were written, and which directories are opened. */
#include "tests/support/unit.h"

#include "tests/support/scratch.h"

#include "tests/support/builder/store_bed.h"

static void entries_come_back(void **state)
{
    (void)state;
    static const uint64_t sizes[] = {0, 1, 4023, 65000, 65536, 65537, 1000000, 3 * 65536};
    for (uint32_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        bed_put(i, sizes[i]);
    bed_close();
    bed_open(UINT64_C(1) << 30);
    for (uint32_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        assert_true(bed_has(i));
    assert_int_equal(store_state(bed_store).read, sizeof sizes / sizeof sizes[0]);
    assert_int_equal(bed_files(), sizeof sizes / sizeof sizes[0]);
}

static void a_missing_entry_is_not_found(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    assert_int_equal(bed_get(1, &error), BVHD_NOT_FOUND);
    assert_int_equal(error.status, BVHD_NOT_FOUND);
    assert_int_equal(store_state(bed_store).damaged, 0);
    bed_put(1, 100);
    assert_int_equal(bed_get(2, &error), BVHD_NOT_FOUND);
}

static void an_entry_is_replaced(void **state)
{
    (void)state;
    bed_put(1, 100000);
    bed_put(1, 100);
    assert_true(bed_has(1));
    struct store_state at = store_state(bed_store);
    assert_int_equal(at.entries, 1);
    assert_int_equal(at.bytes, 4096);
    assert_int_equal(at.written, 2);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    bed_put(1, 100);
    atomic_store(&bed_memory.fail_after, 0);
    assert_int_equal(bed_get(1, &error), BVHD_NO_MEMORY);
    assert_true(bed_has(1));
    bed_close();
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t after = 0; status != BVHD_OK; after++) {
        struct store_options options = {scratch_folder, "development-test1", 1000000, 0, NULL};
        atomic_store(&bed_memory.fail_after, after);
        status = store_open(&options, &bed_memory, &bed_store, &error);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        assert_true(status == BVHD_OK || atomic_load(&bed_memory.live) == 0);
    }
}

enum { THREADS = 4, ROUNDS = 150, SHARED = 20 };

static _Atomic uint32_t wrong;

/* Reads, writes and trims entries that other threads read, write and trim. Assertions are for the main thread only. */
static void *use(void *seed)
{
    struct random random = {(uintptr_t)seed};
    struct bvhd_error error;
    for (int round = 0; round < ROUNDS; round++) {
        uint32_t number = (uint32_t)(random_next(&random) % SHARED);
        enum bvhd_status status;
        switch (random_next(&random) % 8) {
        case 0:
            status = store_trim_to(bed_store, 10 * 4096, &error);
            break;
        case 1:
            status = store_scan(bed_store, &error);
            break;
        case 2:
        case 3:
            status = bed_try_put(number, 1000 + 100 * number, &error);
            break;
        default:
            status = bed_get(number, &error);
        }
        if (status != BVHD_OK && status != BVHD_NOT_FOUND)
            atomic_fetch_add(&wrong, 1);
    }
    return NULL;
}

static void threads_share_a_store(void **state)
{
    (void)state;
    pthread_t threads[THREADS];
    for (uintptr_t i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, use, (void *)(i + 1)), 0);
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_join(threads[i], NULL), 0);
    assert_int_equal(wrong, 0);
    assert_int_equal(store_state(bed_store).damaged, 0);
    assert_int_equal(store_state(bed_store).write_errors, 0);
    struct bvhd_error error;
    assert_int_equal(store_scan(bed_store, &error), BVHD_OK);
    assert_int_equal(bed_files(), store_state(bed_store).entries);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(entries_come_back, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(a_missing_entry_is_not_found, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(an_entry_is_replaced, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(threads_share_a_store, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(every_allocation_may_fail, bed_begin, bed_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
