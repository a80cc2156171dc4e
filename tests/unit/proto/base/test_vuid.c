/* SPDX-License-Identifier: Apache-2.0 */
/* test_vuid.c - tests the list of Vulkan's rules: their spelling, their names, and numbers that never change. */
#include "tests/support/unit.h"

#include <ctype.h>

#include "bvhd/vuid.h"

/* The contents of vuid.def, read independently of vuid.c. */
static const struct rule {
    const char *name, *string;
} rules[] = {
#define BVHD_VUID(name, string) {#name, string},
#include "bvhd/vuid.def"
#undef BVHD_VUID
};

enum { RULE_COUNT = sizeof rules / sizeof rules[0] };

static void every_rule_has_its_string(void **state)
{
    (void)state;
    assert_int_equal(BVHD_VUID_COUNT, RULE_COUNT + 1);
    for (int i = 0; i < RULE_COUNT; i++)
        assert_string_equal(bvhd_vuid_string((enum bvhd_vuid)(i + 1)), rules[i].string);
}

static void strings_are_spelt_like_vulkan(void **state)
{
    (void)state;
    for (int i = 0; i < RULE_COUNT; i++) {
        const char *string = rules[i].string;
        assert_true(strncmp(string, "VUID-Vk", 7) == 0 || strncmp(string, "VUID-vk", 7) == 0);
        int dashes = 0;
        for (const char *at = string; *at; at++) {
            assert_true(isalnum((unsigned char)*at) || *at == '-');
            dashes += *at == '-';
        }
        assert_int_equal(dashes, 3);
    }
}

/* A name is the string's number, or its member and kind after a short form of the struct: "Geometry_sType_sType". */
static void a_name_is_the_end_of_its_string(void **state)
{
    (void)state;
    for (int i = 0; i < RULE_COUNT; i++) {
        char end[100];
        const char *name = rules[i].name;
        const char *from = isdigit((unsigned char)*name) ? name : strchr(name, '_') + 1;
        snprintf(end, sizeof end, "-%s", from);
        for (char *at = end; *at; at++)
            *at = *at == '_' ? '-' : *at;
        const char *string = rules[i].string;
        assert_true(strlen(string) > strlen(end));
        assert_string_equal(string + strlen(string) - strlen(end), end);
        if (isdigit((unsigned char)*name))
            assert_int_equal(strlen(name), 5);
    }
}

static void no_rule_stands_twice(void **state)
{
    (void)state;
    for (int i = 0; i < RULE_COUNT; i++)
        for (int j = 0; j < i; j++)
            assert_string_not_equal(rules[i].string, rules[j].string);
}

/* These numbers are wire ABI. New rules come after them. */
static void numbers_stay(void **state)
{
    (void)state;
    assert_int_equal(BVHD_VUID_NONE, 0);
    assert_int_equal(BVHD_VUID_03654, 1);
    assert_int_equal(BVHD_VUID_BuildGeometryInfo_ppGeometries_parameter, 17);
    assert_int_equal(BVHD_VUID_10418, 18);
    assert_int_equal(BVHD_VUID_10775, 25);
    assert_int_equal(BVHD_VUID_Geometry_sType_sType, 26);
    assert_int_equal(BVHD_VUID_03735, 30);
    assert_int_equal(BVHD_VUID_03545, 38);
    assert_int_equal(BVHD_VUID_03548, 44);
    assert_int_equal(BVHD_VUID_InstancesData_sType_sType, 45);
    assert_int_equal(BVHD_VUID_03799, 48);
    assert_int_equal(BVHD_VUID_04628, 49);
    assert_int_equal(BVHD_VUID_03771, 55);
    assert_int_equal(BVHD_VUID_Build_ppBuildRangeInfos_parameter, 63);
    assert_true(BVHD_VUID_COUNT >= 64);
}

static void unknown_numbers_are_empty(void **state)
{
    (void)state;
    assert_string_equal(bvhd_vuid_string(BVHD_VUID_NONE), "");
    assert_string_equal(bvhd_vuid_string(BVHD_VUID_COUNT), "");
    assert_string_equal(bvhd_vuid_string((enum bvhd_vuid) - 1), "");
    assert_string_equal(bvhd_vuid_string((enum bvhd_vuid)1000000), "");
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_rule_has_its_string),
        cmocka_unit_test(strings_are_spelt_like_vulkan),
        cmocka_unit_test(a_name_is_the_end_of_its_string),
        cmocka_unit_test(no_rule_stands_twice),
        cmocka_unit_test(numbers_stay),
        cmocka_unit_test(unknown_numbers_are_empty),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
