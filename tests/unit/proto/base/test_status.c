/* SPDX-License-Identifier: Apache-2.0 */
/* test_status.c - tests the names of status numbers, and how errors are filled, cut and extended. */
#include "tests/support/unit.h"

#include "proto/base/status.h"

static void names_are_those_of_the_enumerants(void **state)
{
    (void)state;
    static const struct {
        enum bvhd_status status;
        int number; /* on the wire: never changes */
        const char *name;
    } expected[] = {
        {BVHD_OK, 0, "OK"},
        {BVHD_INVALID, 1, "INVALID"},
        {BVHD_UNSUPPORTED, 2, "UNSUPPORTED"},
        {BVHD_TOO_LARGE, 3, "TOO_LARGE"},
        {BVHD_NO_MEMORY, 4, "NO_MEMORY"},
        {BVHD_CANCELLED, 5, "CANCELLED"},
        {BVHD_CORRUPT, 6, "CORRUPT"},
        {BVHD_NOT_FOUND, 7, "NOT_FOUND"},
        {BVHD_BUSY, 8, "BUSY"},
        {BVHD_UNAVAILABLE, 9, "UNAVAILABLE"},
        {BVHD_INCOMPATIBLE, 10, "INCOMPATIBLE"},
        {BVHD_IO, 11, "IO"},
        {BVHD_INTERNAL, 12, "INTERNAL"},
        {BVHD_PENDING, 13, "PENDING"},
        {BVHD_SOURCE_LOST, 14, "SOURCE_LOST"},
    };
    assert_int_equal(BVHD_STATUS_COUNT, sizeof expected / sizeof expected[0]);
    for (size_t i = 0; i < sizeof expected / sizeof expected[0]; i++) {
        assert_int_equal(expected[i].status, expected[i].number);
        assert_string_equal(bvhd_status_name(expected[i].status), expected[i].name);
    }
}

static void unknown_numbers_have_a_name(void **state)
{
    (void)state;
    assert_string_equal(bvhd_status_name(BVHD_STATUS_COUNT), "UNKNOWN");
    assert_string_equal(bvhd_status_name((enum bvhd_status)4000000), "UNKNOWN");
    assert_string_equal(bvhd_status_name((enum bvhd_status) - 1), "UNKNOWN");
}

static void an_error_holds_what_it_was_given(void **state)
{
    (void)state;
    struct bvhd_error error;
    memset(&error, 0xa5, sizeof error);
    assert_int_equal(bvhd_error_set(&error, BVHD_TOO_LARGE, "infos[2]", "%d of %s", 7, "them"), BVHD_TOO_LARGE);
    assert_int_equal(error.status, BVHD_TOO_LARGE);
    assert_int_equal(error.vuid, BVHD_VUID_NONE);
    assert_string_equal(error.where, "infos[2]");
    assert_string_equal(error.text, "7 of them");
}

static void a_rule_is_invalid_and_named(void **state)
{
    (void)state;
    struct bvhd_error error;
    assert_int_equal(bvhd_error_rule(&error, BVHD_VUID_03735, "geometries[0].triangles.vertexStride", "%u", 5u),
                     BVHD_INVALID);
    assert_int_equal(error.status, BVHD_INVALID);
    assert_int_equal(error.vuid, BVHD_VUID_03735);
    assert_string_equal(error.where, "geometries[0].triangles.vertexStride");
    assert_string_equal(error.text, "5");
}

static void no_memory_is_an_error_without_a_rule(void **state)
{
    (void)state;
    struct bvhd_error error;
    assert_int_equal(bvhd_error_no_memory(&error, "blob", "%u bytes", 7u), BVHD_NO_MEMORY);
    assert_int_equal(error.status, BVHD_NO_MEMORY);
    assert_int_equal(error.vuid, BVHD_VUID_NONE);
    assert_string_equal(error.where, "blob");
    assert_string_equal(error.text, "7 bytes");
}

static void without_an_error_only_the_status_comes_back(void **state)
{
    (void)state;
    assert_int_equal(bvhd_error_set(NULL, BVHD_IO, "x", "%s", "y"), BVHD_IO);
    assert_int_equal(bvhd_error_rule(NULL, BVHD_VUID_03654, "x", "%s", "y"), BVHD_INVALID);
    assert_int_equal(bvhd_error_no_memory(NULL, "x", "%s", "y"), BVHD_NO_MEMORY);
}

static void no_place_is_an_empty_place(void **state)
{
    (void)state;
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_IO, NULL, "text");
    assert_string_equal(error.where, "");
}

static void long_words_are_cut(void **state)
{
    (void)state;
    char words[1000];
    memset(words, 'w', sizeof words);
    words[sizeof words - 1] = '\0';
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_IO, words, "%s", words);
    assert_int_equal(strlen(error.where), BVHD_WHERE_SIZE - 1);
    assert_int_equal(strlen(error.text), BVHD_TEXT_SIZE - 1);
}

static void an_error_is_one_line(void **state)
{
    (void)state;
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_IO, "a\nb", "one\ntwo\r\x1b[1m\x7f.");
    assert_string_equal(error.where, "a b");
    assert_string_equal(error.text, "one two  [1m .");
}

static void an_error_can_be_told_again(void **state)
{
    (void)state;
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_CORRUPT, "header", "bad");
    bvhd_error_set(&error, BVHD_IO, error.where, "file x: %s", error.text);
    assert_int_equal(error.status, BVHD_IO);
    assert_string_equal(error.where, "header");
    assert_string_equal(error.text, "file x: bad");
}

static void a_deadline_is_a_cancellation(void **state)
{
    (void)state;
    struct bvhd_error error;
    assert_int_equal(bvhd_error_deadline(&error, 250), BVHD_CANCELLED);
    assert_int_equal(error.status, BVHD_CANCELLED);
    assert_string_equal(error.where, BVHD_ERROR_DEADLINE);
    assert_string_equal(error.text, "no result within 250 ms, the deadline of the request");
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_are_those_of_the_enumerants),
        cmocka_unit_test(unknown_numbers_have_a_name),
        cmocka_unit_test(an_error_holds_what_it_was_given),
        cmocka_unit_test(a_rule_is_invalid_and_named),
        cmocka_unit_test(no_memory_is_an_error_without_a_rule),
        cmocka_unit_test(without_an_error_only_the_status_comes_back),
        cmocka_unit_test(no_place_is_an_empty_place),
        cmocka_unit_test(long_words_are_cut),
        cmocka_unit_test(an_error_is_one_line),
        cmocka_unit_test(an_error_can_be_told_again),
        cmocka_unit_test(a_deadline_is_a_cancellation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
