/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_mapping.c - tests the cache of unused mappings: what is kept, what is dropped, and its use from several threads.
 */
#include "tests/support/unit.h"

#include <stdio.h>
#include <sys/resource.h>
#include <unistd.h>

#include "proto/base/mapping.h"
#include "builder/workers.h"

enum { MIB = 1 << 20 };

static void *obtain(uint64_t length, uint64_t *ret_length)
{
    unsigned char *mapping = mapping_obtain(length, ret_length);
    assert_non_null(mapping);
    assert_int_equal((uintptr_t)mapping % (2 * MIB), 0);
    assert_in_range(*ret_length, length, length + length / 4);
    mapping[0] = mapping[*ret_length - 1] = 1;
    return mapping;
}

static void nothing_is_kept_unless_told(void **state)
{
    (void)state;
    uint64_t length = 0, other = 0;
    mapping_keep(0);
    void *mapping = obtain(5 * MIB, &length);
    assert_int_equal(length, 5 * MIB);
    mapping_release(mapping, length);
    mapping = obtain(4 * MIB, &other);
    assert_int_equal(other, 4 * MIB);
    mapping_release(mapping, other);
}

static void what_fits_is_used_again(void **state)
{
    (void)state;
    uint64_t lengths[3], again;
    void *mappings[3];
    mapping_keep(64 * MIB);
    for (uint64_t i = 0; i < 3; i++)
        mappings[i] = obtain((8 + i) * MIB, &lengths[i]);
    for (uint64_t i = 0; i < 3; i++)
        mapping_release(mappings[i], lengths[i]);
    /* The shortest mapping that is long enough is taken, and none that is more than a quarter too long. */
    void *mapping = obtain(9 * MIB, &again);
    assert_ptr_equal(mapping, mappings[1]);
    assert_int_equal(again, 9 * MIB);
    void *second = obtain(9 * MIB, &again);
    assert_ptr_equal(second, mappings[2]);
    assert_int_equal(again, 10 * MIB);
    void *third = obtain(6 * MIB, &again);
    assert_int_equal(again, 6 * MIB);
    mapping_release(third, 6 * MIB);
    mapping_release(second, 10 * MIB);
    mapping_release(mapping, 9 * MIB);
    mapping_keep(0);
}

static void the_limit_holds(void **state)
{
    (void)state;
    uint64_t length;
    mapping_keep(10 * MIB);
    void *first = obtain(6 * MIB, &length), *second = obtain(5 * MIB, &length), *large = obtain(11 * MIB, &length);
    mapping_release(large, 11 * MIB); /* is larger than the whole cache may be */
    mapping_release(first, 6 * MIB);
    mapping_release(second, 5 * MIB); /* drops the first one */
    void *mapping = obtain(5 * MIB, &length), *other = obtain(5 * MIB, &length);
    assert_ptr_equal(mapping, second);
    assert_int_equal(length, 5 * MIB);
    mapping_release(mapping, 5 * MIB);
    mapping_release(other, 5 * MIB);
    mapping_keep(5 * MIB); /* the other one stays, because it was used last */
    mapping = obtain(5 * MIB, &length);
    assert_ptr_equal(mapping, other);
    mapping_release(mapping, length);
    mapping_keep(0);
}

/* More mappings are released than the cache can list. */
static void many_are_kept_or_go(void **state)
{
    (void)state;
    enum { COUNT = 100 };
    void *mappings[COUNT];
    uint64_t length;
    mapping_keep(UINT64_MAX);
    for (int round = 0; round < 3; round++) {
        for (int i = 0; i < COUNT; i++)
            mappings[i] = obtain(8192, &length);
        for (int i = 0; i < COUNT; i++)
            mapping_release(mappings[i], 8192);
    }
    mapping_keep(0);
}

static uint64_t address_space(void)
{
    unsigned long long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    assert_non_null(file);
    assert_int_equal(fscanf(file, "%llu", &pages), 1);
    fclose(file);
    return pages * (uint64_t)sysconf(_SC_PAGESIZE);
}

/* Where address space is limited, the cache is emptied before an allocation fails. */
static void kept_ones_give_way(void **state)
{
    (void)state;
    struct rlimit old, tight;
    uint64_t length, other_length;
    mapping_keep(256 * MIB);
    mapping_release(obtain(128 * MIB, &length), 128 * MIB);
    assert_int_equal(getrlimit(RLIMIT_AS, &old), 0);
    tight = (struct rlimit){address_space() + 16 * MIB, old.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_AS, &tight), 0);
    unsigned char *mapping = mapping_obtain(48 * MIB, &length), *other = mapping_obtain(40 * MIB, &other_length);
    if (other)
        mapping_release(other, other_length);
    unsigned char *moved = mapping && other ? mapping_resize(mapping, length, 60 * MIB) : NULL;
    assert_int_equal(setrlimit(RLIMIT_AS, &old), 0);
    assert_non_null(mapping);
    assert_non_null(moved);
    mapping_release(moved, 60 * MIB);
    mapping_keep(0);
}

static void resizing_keeps_contents(void **state)
{
    (void)state;
    uint64_t length = 0;
    unsigned char *mapping = obtain(3 * MIB, &length);
    for (uint64_t i = 0; i < length; i++)
        mapping[i] = (unsigned char)(i * 7 >> 8);
    mapping = mapping_resize(mapping, length, 9 * MIB);
    assert_non_null(mapping);
    assert_int_equal((uintptr_t)mapping % (2 * MIB), 0);
    mapping[9 * MIB - 1] = 3;
    mapping = mapping_resize(mapping, 9 * MIB, MIB);
    assert_non_null(mapping);
    for (uint64_t i = 0; i < MIB; i++)
        assert_int_equal(mapping[i], (unsigned char)(i * 7 >> 8));
    assert_null(mapping_resize(mapping, MIB, UINT64_MAX / 2 / 4096 * 4096));
    assert_int_equal(mapping[4095], (unsigned char)(4095 * 7 >> 8));
    mapping_release(mapping, MIB);
    assert_null(mapping_obtain(UINT64_MAX / 4096 * 4096, &length));
}

/* No thread gets a mapping that another thread holds. */
static void take_turns(void *context, size_t index)
{
    (void)context;
    for (uint64_t round = 0; round < 50; round++) {
        uint64_t length;
        unsigned char *mapping = mapping_obtain((1 + round % 3) * 65536, &length);
        assert_non_null(mapping);
        memset(mapping, (int)index, length);
        for (uint64_t i = 0; i < length; i += 4096)
            assert_int_equal(mapping[i], (unsigned char)index);
        mapping_release(mapping, length);
    }
}

static void threads_share_what_is_kept(void **state)
{
    (void)state;
    struct workers *workers;
    assert_int_equal(workers_create(4, &workers, NULL), BVHD_OK);
    mapping_keep(MIB);
    parallel_for(workers_parallel(workers), 16, take_turns, NULL);
    mapping_keep(0);
    workers_destroy(workers);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_is_kept_unless_told),
        cmocka_unit_test(what_fits_is_used_again),
        cmocka_unit_test(the_limit_holds),
        cmocka_unit_test(many_are_kept_or_go),
        cmocka_unit_test(kept_ones_give_way),
        cmocka_unit_test(resizing_keeps_contents),
        cmocka_unit_test(threads_share_what_is_kept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
