/* SPDX-License-Identifier: Apache-2.0 */
/* test_json.c - tests the writer of JSON. */
#include "tests/support/unit.h"

#include <cjson/cJSON.h>
#include <math.h>

#include "client/bvhctl/base/json.h"

struct fixture {
    struct memory memory;
    struct json json;
};

static void begin(struct fixture *fixture, bool lines)
{
    memory_init(&fixture->memory, UINT64_MAX);
    json_init(&fixture->json, &fixture->memory, lines);
}

static void expect(struct fixture *fixture, const char *text)
{
    assert_false(fixture->json.failed);
    assert_int_equal(fixture->json.size, strlen(text));
    assert_memory_equal(fixture->json.data, text, strlen(text));
    json_finish(&fixture->json);
    json_finish(&fixture->json);
    assert_int_equal(fixture->memory.live, 0);
}

static void write_sample(struct json *json)
{
    json_object(json, NULL);
    json_integer(json, "n", UINT64_MAX);
    json_array(json, "list");
    json_text(json, NULL, "a");
    json_bool(json, NULL, true);
    json_null(json, NULL);
    json_object(json, NULL);
    json_object_end(json);
    json_array_end(json);
    json_array(json, "none");
    json_array_end(json);
    json_object_end(json);
}

static void test_compact(void **state)
{
    (void)state;
    struct fixture fixture;
    begin(&fixture, false);
    write_sample(&fixture.json);
    json_newline(&fixture.json);
    expect(&fixture, "{\"n\":18446744073709551615,\"list\":[\"a\",true,null,{}],\"none\":[]}\n");
}

static void test_lines(void **state)
{
    (void)state;
    struct fixture fixture;
    begin(&fixture, true);
    write_sample(&fixture.json);
    expect(&fixture, "{\n  \"n\": 18446744073709551615,\n  \"list\": [\n    \"a\",\n    true,\n    null,\n    {}\n  "
                     "],\n  \"none\": []\n}");
}

static void check_text(const char *given, const char *written)
{
    struct fixture fixture;
    begin(&fixture, false);
    json_text(&fixture.json, NULL, given);
    expect(&fixture, written);
}

static void test_texts(void **state)
{
    (void)state;
    check_text("", "\"\"");
    check_text("a \"b\" \\c", "\"a \\\"b\\\" \\\\c\"");
    check_text("\n\t\x01\x7f", "\"\\u000a\\u0009\\u0001\\u007f\"");
    check_text("\xc3\xa4 \xe2\x82\xac \xf0\x9f\x90\x89", "\"\xc3\xa4 \xe2\x82\xac \xf0\x9f\x90\x89\"");
}

/* Invalid UTF-8 is replaced: lone continuation, overlong, surrogate, beyond the last code point, truncated. */
static void test_broken_utf8(void **state)
{
    (void)state;
    check_text("a\x80z", "\"a\xef\xbf\xbdz\"");
    check_text("\xc0\xaf", "\"\xef\xbf\xbd\xef\xbf\xbd\"");
    check_text("\xe0\x80\xaf", "\"\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\"");
    check_text("\xed\xa0\x80", "\"\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\"");
    check_text("\xf4\x90\x80\x80", "\"\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\"");
    check_text("\xff", "\"\xef\xbf\xbd\"");
    check_text("x\xe2\x82", "\"x\xef\xbf\xbd\xef\xbf\xbd\"");
}

static void check_number(double given, const char *written)
{
    struct fixture fixture;
    begin(&fixture, false);
    json_number(&fixture.json, NULL, given);
    expect(&fixture, written);
}

static void test_numbers(void **state)
{
    (void)state;
    check_number(0, "0");
    check_number(0.1, "0.1");
    check_number(-2.5, "-2.5");
    check_number(1.0 / 3, "0.3333333333333333");
    check_number(0x1p-1074, "4.94065645841247e-324");
    check_number((double)INFINITY, "null");
    check_number((double)-INFINITY, "null");
    check_number((double)NAN, "null");
}

static void test_append(void **state)
{
    (void)state;
    struct fixture fixture, part;
    begin(&fixture, false);
    begin(&part, false);
    json_array(&fixture.json, NULL);
    json_append(&fixture.json, &part.json);
    json_integer(&part.json, NULL, 1);
    json_integer(&part.json, NULL, 2);
    json_append(&fixture.json, &part.json);
    json_integer(&fixture.json, NULL, 3);
    json_array_end(&fixture.json);
    expect(&fixture, "[1,2,3]");
    json_finish(&part.json);
}

static void test_no_memory(void **state)
{
    (void)state;
    struct fixture fixture;
    for (int64_t after = 0;; after++) {
        begin(&fixture, true);
        atomic_store(&fixture.memory.fail_after, after);
        write_sample(&fixture.json);
        bool failed = fixture.json.failed;
        json_finish(&fixture.json);
        assert_int_equal(fixture.memory.live, 0);
        if (!failed)
            break;
        assert_true(after < 100);
    }
    json_finish(NULL);
}

/* Every float comes back, by the fewest digits that do it, or one more. */
static void test_floats(void **state)
{
    (void)state;
    static const struct {
        float value;
        const char *text;
    } known[] = {{0, "0"},           {-0.0f, "-0"},          {1, "1"},
                 {-2.5f, "-2.5"},    {0.1f, "0.1"},          {1e-3f, "0.001"},
                 {123456, "123456"}, {16777216, "16777216"}, {0.3333333f, "0.3333333"},
                 {1e30f, "1e+30"},   {1e-30f, "1e-30"},      {1.0000001f, "1.0000001"},
                 {1e6f, "1e+06"},    {NAN, "null"},          {-INFINITY, "null"}};
    struct fixture fixture;
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        begin(&fixture, false);
        json_float(&fixture.json, NULL, known[i].value);
        expect(&fixture, known[i].text);
    }
    uint32_t bits = 1;
    for (int i = 0; i < 200000; i++, bits = bits * 1664525 + 1013904223) {
        float value;
        char text[64], fewest[64];
        memcpy(&value, &bits, sizeof value);
        if (i % 2)
            value = (float)bits / 4294967296.0f * (float)(i % 999);
        if (!isfinite(value))
            continue;
        begin(&fixture, false);
        json_float(&fixture.json, NULL, value);
        json_newline(&fixture.json);
        memcpy(text, fixture.json.data, fixture.json.size);
        text[fixture.json.size - 1] = '\0';
        json_finish(&fixture.json);
        for (int digits = 1; digits <= 9; digits++) {
            snprintf(fewest, sizeof fewest, "%.*g", digits, (double)value);
            if (strtof(fewest, NULL) == value)
                break;
        }
        bool is_short = strtod(text, NULL) == strtod(fewest, NULL) || strlen(text) == strlen(fewest) + 1;
        if (strtof(text, NULL) != value || !is_short)
            fail_msg("%.9g is %s, not %s", (double)value, text, fewest);
    }
}

static void test_float_list(void **state)
{
    (void)state;
    static const float values[] = {1, -0.5f, 3};
    struct fixture fixture;
    begin(&fixture, true);
    json_object(&fixture.json, NULL);
    json_floats(&fixture.json, "v", values, 3);
    json_floats(&fixture.json, "none", values, 0);
    json_object_end(&fixture.json);
    expect(&fixture, "{\n  \"v\": [1,-0.5,3],\n  \"none\": []\n}");
}

static void test_clean_text(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    char *clean = json_clean_text(&memory, "a\xff\xc3\xa4\xc3");
    assert_string_equal(clean, "a\xef\xbf\xbd\xc3\xa4\xef\xbf\xbd");
    memory_free(&memory, clean);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_compact),     cmocka_unit_test(test_floats),  cmocka_unit_test(test_float_list),
        cmocka_unit_test(test_clean_text),  cmocka_unit_test(test_lines),   cmocka_unit_test(test_texts),
        cmocka_unit_test(test_broken_utf8), cmocka_unit_test(test_numbers), cmocka_unit_test(test_append),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests_name("json", tests, NULL, NULL);
}
