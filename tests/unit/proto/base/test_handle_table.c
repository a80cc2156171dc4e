/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_handle_table.c - tests that handles are sorted, found, and reported as unknown, and that a sort can be
 * cancelled.
 */
#include "tests/support/unit.h"

#include <stdbool.h>

#include "proto/base/handle_table.h"
#include "tests/support/random.h"

enum { MOST = 3000 };

static void check(struct handle_entry *entries, uint32_t count)
{
    static struct handle_entry given[MOST], scratch[MOST];
    memcpy(given, entries, count * sizeof *entries);
    handle_sort(entries, scratch, count);
    for (uint32_t i = 1; i < count; i++) {
        assert_true(entries[i - 1].handle <= entries[i].handle);
        if (entries[i - 1].handle == entries[i].handle)
            assert_true(entries[i - 1].number < entries[i].number);
    }
    for (uint32_t i = 0; i < count; i++) {
        uint32_t at = handle_find(entries, count, given[i].handle);
        assert_true(at < count && entries[at].handle == given[i].handle);
        assert_true(at == 0 || entries[at - 1].handle < given[i].handle);
        assert_int_equal(entries[i].handle, given[entries[i].number].handle);
    }
}

static void sorts_and_finds(void **state)
{
    (void)state;
    static struct handle_entry entries[MOST];
    struct random random = {1};
    for (unsigned bits = 1; bits <= 64; bits += 7)
        for (uint32_t count = 0; count <= MOST; count = count * 2 + 1) {
            for (uint32_t i = 0; i < count; i++)
                entries[i] = (struct handle_entry){random_next(&random) >> (64 - bits), i};
            check(entries, count);
        }
}

static void unknown_handles_are_none(void **state)
{
    (void)state;
    static struct handle_entry entries[100];
    for (uint32_t i = 0; i < 100; i++)
        entries[i] = (struct handle_entry){(uint64_t)2 * i + 2, i};
    for (uint32_t count = 0; count <= 100; count++)
        for (uint64_t handle = 0; handle <= 203; handle++) {
            bool known = handle > 0 && handle % 2 == 0 && handle / 2 <= count;
            assert_int_equal(handle_find(entries, count, handle), known ? (uint32_t)(handle / 2 - 1) : HANDLE_NONE);
        }
    assert_int_equal(handle_find(entries, 100, UINT64_MAX), HANDLE_NONE);
    assert_int_equal(handle_find(NULL, 0, 5), HANDLE_NONE);
}

static void cancelled_sorts_say_so(void **state)
{
    (void)state;
    struct handle_entry entries[] = {{7, 0}, {3, 1}, {5, 2}}, scratch[3];
    atomic_bool cancel = true;
    assert_false(handle_sort_until(entries, scratch, 3, &cancel));
    cancel = false;
    assert_true(handle_sort_until(entries, scratch, 3, &cancel));
    assert_true(handle_sort_until(entries, scratch, 3, NULL));
    assert_true(entries[0].handle == 3 && entries[1].handle == 5 && entries[2].handle == 7);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(sorts_and_finds), cmocka_unit_test(unknown_handles_are_none),
                                       cmocka_unit_test(cancelled_sorts_say_so)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
