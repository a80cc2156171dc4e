/* SPDX-License-Identifier: Apache-2.0 */
/* test_log.c - tests that log lines have the documented form, whatever text they contain, and that levels apply. */
#include <sys/stat.h>

#include "tests/support/unit.h"

#include "daemon/system/log.h"
#include "tests/support/daemon/capture_log.h"

static char text[CAPTURE_SIZE];

static void capture(void (*event)(void))
{
    struct capture capture = capture_begin();
    event();
    capture_end(&capture, text);
}

static void plain(void)
{
    log_event(LOG_INFO, "started", NULL);
    log_event(LOG_WARNING, "short", "of=%s left=%d", "memory", 3);
}

static void test_line(void **state)
{
    int used = 0;
    (void)state;
    capture(plain);
    assert_int_equal(sscanf(text, "%*4d-%*2d-%*2dT%*2d:%*2d:%*2d.%*3dZ level=info event=started\n%n", &used), 0);
    assert_int_equal(used, strlen("2026-01-01T00:00:00.000Z level=info event=started\n"));
    assert_string_equal(text + used + strlen("2026-01-01T00:00:00.000Z"),
                        " level=warning event=short of=memory left=3\n");
}

static void all_levels(void)
{
    log_event(LOG_ERROR, "e", NULL);
    log_event(LOG_WARNING, "w", NULL);
    log_event(LOG_INFO, "i", NULL);
    log_event(LOG_DEBUG, "d", NULL);
}

static void test_levels(void **state)
{
    (void)state;
    capture(all_levels);
    assert_non_null(strstr(text, "event=i"));
    assert_null(strstr(text, "event=d"));
    log_set_level(LOG_ERROR);
    capture(all_levels);
    assert_non_null(strstr(text, "level=error event=e\n"));
    assert_null(strstr(text, "event=w"));
    log_set_level(LOG_DEBUG);
    capture(all_levels);
    assert_non_null(strstr(text, "level=debug event=d\n"));
    log_set_level(LOG_INFO);
}

static void hostile(void)
{
    log_event(LOG_INFO, "hello", "name=%s", log_quote("a\" level=error event=fire\nx\\\033[2J\x7f").text);
    log_event(LOG_INFO, "raw", "name=%s", "two\nlines");
}

static void test_hostile_text(void **state)
{
    (void)state;
    capture(hostile);
    assert_non_null(strstr(text, "event=hello name=\"a' level=error event=fire?x'?[2J?\"\n"));
    assert_non_null(strstr(text, "event=raw name=two?lines\n"));
    for (const char *at = text; *at; at++)
        assert_true((unsigned char)*at >= 0x20 || *at == '\n');
}

static void long_lines(void)
{
    static char much[5000];
    memset(much, 'x', sizeof much - 1);
    log_event(LOG_INFO, "much", "text=%s", much);
    log_event(LOG_INFO, "quoted", "text=%s", log_quote(much).text);
    log_event(LOG_INFO, much, NULL);
}

static void test_long_lines(void **state)
{
    (void)state;
    capture(long_lines);
    char *second = strchr(text, '\n') + 1, *third = strchr(second, '\n') + 1;
    assert_int_equal(second - text, 1000);
    assert_in_range(third - second, 255, 330);
    assert_memory_equal(third - 2, "\"\n", 2);
    assert_int_equal(strlen(third), 1000);
    assert_int_equal(strchr(third, '\n') - third, 999);
}

static void test_limit(void **state)
{
    struct log_limit limit = {0};
    uint32_t suppressed = 77;
    (void)state;
    assert_true(log_limit_pass(&limit, &suppressed));
    assert_int_equal(suppressed, 0);
    for (int i = 0; i < 5; i++)
        assert_false(log_limit_pass(&limit, &suppressed));
    limit.next_ms -= 1000; /* as if a second had passed */
    assert_true(log_limit_pass(&limit, &suppressed));
    assert_int_equal(suppressed, 5);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_line),       cmocka_unit_test(test_levels), cmocka_unit_test(test_hostile_text),
        cmocka_unit_test(test_long_lines), cmocka_unit_test(test_limit),
    };
    unsetenv("JOURNAL_STREAM");
    return cmocka_run_group_tests(tests, NULL, NULL);
}
