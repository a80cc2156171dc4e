/* SPDX-License-Identifier: Apache-2.0 */
/* test_import_names.c - tests that names of nodes come back as they were added, also without memory. */
#include "tests/support/unit.h"

#include "client/bvhctl/scene/import_names.h"

static void names_come_back(void **state)
{
    struct memory memory;
    struct import_names names = {0};
    uint32_t offsets[1000], empty = 7;
    char name[16];
    (void)state;
    memory_init(&memory, UINT64_MAX);
    assert_string_equal(import_names_get(&names, 0), "");
    for (int i = 0; i < 1000; i++) {
        snprintf(name, sizeof name, "node %d", i);
        assert_true(import_names_add(&names, name, &memory, &offsets[i]));
        assert_true(import_names_add(&names, i % 2 ? NULL : "", &memory, &empty));
        assert_int_equal(empty, 0);
    }
    for (int i = 0; i < 1000; i++) {
        snprintf(name, sizeof name, "node %d", i);
        assert_string_equal(import_names_get(&names, offsets[i]), name);
    }
    assert_string_equal(import_names_get(&names, 0), "");
    assert_string_equal(import_names_get(&names, UINT32_MAX), "");
    memory_free(&memory, names.texts);
    assert_int_equal(memory.live, 0);
}

static void without_memory(void **state)
{
    struct memory memory;
    struct import_names names = {0};
    uint32_t offset;
    (void)state;
    memory_init(&memory, UINT64_MAX);
    memory.fail_after = 0;
    assert_false(import_names_add(&names, "a", &memory, &offset));
    assert_true(import_names_add(&names, "a", &memory, &offset));
    memory_free(&memory, names.texts);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(names_come_back), cmocka_unit_test(without_memory)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
