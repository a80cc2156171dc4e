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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_compact),     cmocka_unit_test(test_lines),   cmocka_unit_test(test_texts),
        cmocka_unit_test(test_broken_utf8), cmocka_unit_test(test_numbers), cmocka_unit_test(test_append),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests_name("json", tests, NULL, NULL);
}
