/* SPDX-License-Identifier: Apache-2.0 */
/* test_control_codec.c - tests the bounds on what a control message may unpack to, which no kind reaches itself. */
#include "tests/support/unit.h"

#include "proto/wire/control.h"
#include "proto/wire/control_codec.h"

extern const ProtobufCMessageDescriptor bvhd__busy__descriptor;

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static uint64_t extra;

static enum bvhd_status check(const void *from, uint64_t *ret_extra, struct bvhd_error *error)
{
    (void)from, (void)error;
    *ret_extra = extra;
    return BVHD_OK;
}

static void fill(const void *from, void *ret_plain)
{
    (void)from;
    *(uint32_t *)ret_plain = 7;
}

static enum bvhd_status decode(uint64_t size, void **ret_plain)
{
    static const struct control_kind kind = {"sample", &bvhd__busy__descriptor, sizeof(uint32_t), check, fill};
    struct bvhd_error error = {0};
    enum bvhd_status status =
        control_decode(&kind, (struct bytes){(const unsigned char *)"", size}, &memory, ret_plain, &error);
    if (status != BVHD_OK)
        assert_string_equal(error.where, "sample");
    return status;
}

/* A message may become as large as its share of the heap, and no larger. */
static void plain_structs_are_bounded(void **state)
{
    (void)state;
    void *plain = NULL;
    extra = CONTROL_HEAP_FIXED / 2 - sizeof(uint32_t);
    assert_int_equal(decode(0, &plain), BVHD_OK);
    assert_int_equal(*(uint32_t *)plain, 7);
    memory_free(&memory, plain);
    extra++;
    assert_int_equal(decode(0, &plain), BVHD_TOO_LARGE);
    extra = UINT64_MAX;
    assert_int_equal(decode(0, &plain), BVHD_TOO_LARGE);
    assert_int_equal(memory.live, 0);
}

/* Sizes whose share is no number are refused before a byte is read. */
static void sizes_that_overflow_are_refused(void **state)
{
    (void)state;
    void *plain = NULL;
    extra = 0;
    assert_int_equal(decode(UINT64_MAX, &plain), BVHD_TOO_LARGE);
    assert_int_equal(decode(UINT64_MAX / (CONTROL_HEAP_RATIO / 2), &plain), BVHD_TOO_LARGE);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_structs_are_bounded),
        cmocka_unit_test(sizes_that_overflow_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
