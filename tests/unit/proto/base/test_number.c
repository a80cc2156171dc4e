/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_number.c - tests that numbers are read with their suffixes, and that other texts and values out of range are
 * refused.
 */
#include "tests/support/unit.h"

#include <string.h>

#include "proto/base/number.h"

static const struct number_range any = {0, UINT64_MAX, true};

static void expect(const char *text, struct number_range range, uint64_t value)
{
    struct bvhd_error error;
    uint64_t got = ~value;
    assert_int_equal(number_read("--n", text, range, &got, &error), BVHD_OK);
    assert_true(got == value);
}

static void refuse(const char *text, struct number_range range, const char *why)
{
    struct bvhd_error error;
    uint64_t got = 77;
    assert_int_equal(number_read("--n", text, range, &got, &error), BVHD_INVALID);
    assert_string_equal(error.where, "--n");
    if (!strstr(error.text, why))
        fail_msg("%s: %s", text, error.text);
    assert_int_equal(got, 77);
}

static void test_numbers(void **state)
{
    (void)state;
    expect("0", any, 0);
    expect("007", any, 7);
    expect("18446744073709551615", any, UINT64_MAX);
    expect("3K", any, 3 << 10);
    expect("64M", any, 64 << 20);
    expect("2G", any, UINT64_C(2) << 30);
    expect("17179869183G", any, UINT64_C(17179869183) << 30);
}

static void test_what_is_none(void **state)
{
    (void)state;
    static const char *const texts[] = {"",
                                        " 1",
                                        "1 ",
                                        "+1",
                                        "-1",
                                        "x",
                                        "1x",
                                        "0x10",
                                        "1.5",
                                        "K",
                                        "1k",
                                        "1KK",
                                        "1T",
                                        "1K1",
                                        "18446744073709551616",
                                        "17179869184G",
                                        "99999999999999999999999K"};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        refuse(texts[i], any, "not a whole number");
    refuse("1K", (struct number_range){0, UINT64_MAX, false}, "not a whole number");
}

static void test_ranges(void **state)
{
    (void)state;
    static const struct number_range range = {2, 2048, true};
    expect("2", range, 2);
    expect("2K", range, 2048);
    refuse("1", range, "not between 2 and 2048: '1'");
    refuse("2049", range, "not between 2 and 2048");
    refuse("3K", range, "not between 2 and 2048");
}

static void test_32_bits(void **state)
{
    (void)state;
    struct bvhd_error error;
    uint32_t got = 5;
    assert_int_equal(number_read32("n", "4294967295", (struct number_range){0, UINT32_MAX, false}, &got, &error),
                     BVHD_OK);
    assert_int_equal(got, UINT32_MAX);
    assert_int_equal(number_read32("n", "4294967296", (struct number_range){0, UINT32_MAX, false}, &got, &error),
                     BVHD_INVALID);
    assert_int_equal(got, UINT32_MAX);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_numbers),
        cmocka_unit_test(test_what_is_none),
        cmocka_unit_test(test_ranges),
        cmocka_unit_test(test_32_bits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
