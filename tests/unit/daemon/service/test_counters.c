/* SPDX-License-Identifier: Apache-2.0 */
/* test_counters.c - tests that the packed counters carry each name and value. */
#include "tests/support/unit.h"

#include "proto/wire/control.h"
#include "daemon/service/counters.h"

static void test_every_counter_travels_by_its_name(void **state)
{
    (void)state;
    struct memory memory;
    struct counters counters;
    struct bytes bytes;
    struct control_counters *message;
    memory_init(&memory, UINT64_MAX);
    uint64_t values[sizeof counters / sizeof(uint64_t)], count = sizeof values / sizeof *values;
    for (uint64_t i = 0; i < count; i++)
        values[i] = i * UINT64_C(0x0101010101010101);
    memcpy(&counters, values, sizeof counters);
    assert_int_equal(counters_pack(&counters, &memory, &bytes, NULL), BVHD_OK);
    assert_int_equal(control_unpack_counters(bytes, &memory, &message, NULL), BVHD_OK);
    assert_int_equal(message->count, count);
    uint32_t at = 0;
#define CHECK(counter)                                                                                                 \
    assert_string_equal(message->counters[at].name, #counter);                                                         \
    assert_int_equal(message->counters[at++].value, counters.counter);
    COUNTERS(CHECK)
#undef CHECK
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < i; k++)
            assert_string_not_equal(message->counters[i].name, message->counters[k].name);
    memory_free(&memory, message);
    memory_free(&memory, (void *)(uintptr_t)bytes.data);
    assert_int_equal(atomic_load(&memory.live), 0);
}

static void test_names_fit_and_there_is_room_for_more(void **state)
{
    (void)state;
#define CHECK(counter) assert_true(sizeof #counter < CONTROL_NAME_SIZE);
    COUNTERS(CHECK)
#undef CHECK
    assert_true(sizeof(struct counters) / sizeof(uint64_t) < CONTROL_MAX_COUNTERS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_counter_travels_by_its_name),
        cmocka_unit_test(test_names_fit_and_there_is_room_for_more),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
