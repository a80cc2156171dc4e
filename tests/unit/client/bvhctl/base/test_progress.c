/* SPDX-License-Identifier: Apache-2.0 */
/* test_progress.c - tests where progress is shown, and that its line leaves nothing behind. */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "client/bvhctl/base/progress.h"
#include "client/bvhctl/base/report.h"

enum { PATIENCE_MS = 60000, COLUMNS = 60 };

/* Text for stderr comes to `from` instead. */
struct redirection {
    int from, stderr_copy;
};

static struct redirection redirect(int from, int to)
{
    struct redirection redirection = {from, dup(STDERR_FILENO)};
    assert_true(to >= 0 && redirection.stderr_copy >= 0);
    assert_int_equal(dup2(to, STDERR_FILENO), STDERR_FILENO);
    close(to);
    return redirection;
}

static void restore(struct redirection *redirection)
{
    dup2(redirection->stderr_copy, STDERR_FILENO);
    close(redirection->stderr_copy);
    close(redirection->from);
}

/* Reads until `text` has come. */
static void expect_text(int from, const char *text, char *ret_all, size_t size)
{
    size_t used = strlen(ret_all);
    while (!strstr(ret_all, text)) {
        struct pollfd poller = {from, POLLIN, 0};
        if (poll(&poller, 1, PATIENCE_MS) <= 0)
            fail_msg("'%s' does not come, but '%s'", text, ret_all);
        ssize_t got = read(from, ret_all + used, size - 1 - used);
        assert_true(got > 0);
        used += (size_t)got;
        ret_all[used] = '\0';
    }
}

static int open_terminal(int *ret_terminal)
{
    int master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 || grantpt(master) || unlockpt(master))
        skip();
    *ret_terminal = open(ptsname(master), O_RDWR | O_NOCTTY);
    ioctl(*ret_terminal, TIOCSWINSZ, &(struct winsize){.ws_row = 24, .ws_col = COLUMNS});
    return master;
}

/* Replaces what was written to a terminal by what is seen there at the end. No line may be as wide as the terminal. */
static void show(char *text)
{
    size_t used = 0, line = 0, column = 0, length = strlen(text);
    for (size_t i = 0; i < length; i++) {
        if (text[i] == '\r') {
            column = 0;
        } else if (!strncmp(text + i, "\033[K", 3)) {
            used = line + column;
            i += 2;
        } else if (text[i] == '\n') {
            text[used++] = '\n';
            line = used;
            column = 0;
        } else {
            text[line + column++] = text[i];
            used = line + column > used ? line + column : used;
            assert_true(column < COLUMNS);
        }
    }
    text[used] = '\0';
}

/* On a terminal the line is drawn without any report of progress, shows the fraction when there is one, and goes. */
static void test_terminal(void **state)
{
    (void)state;
    char all[65536] = "";
    int terminal, master = open_terminal(&terminal);
    struct redirection redirection = redirect(master, terminal);
    struct progress progress = {0};
    report_set_volume(REPORT_RESULTS);
    progress_begin(&progress, "building", "a name of many letters that does not fit into such a narrow terminal\n");
    expect_text(master, "building a name", all, sizeof all);
    progress_update(&progress, 1, 4);
    expect_text(master, "25 %", all, sizeof all);
    progress_update(&progress, 3, 4);
    progress_update(&progress, 2, 4); /* another thread's, which was late */
    expect_text(master, "75 %", all, sizeof all);
    report_note("what", "a remark");
    expect_text(master, "bvhctl: what: a remark", all, sizeof all);
    progress_end(&progress);
    progress_end(&progress);
    report_note("what", "the end");
    expect_text(master, "bvhctl: what: the end\r\n", all, sizeof all);
    restore(&redirection);
    assert_null(strstr(all, "50 %"));
    show(all);
    assert_string_equal(all, "bvhctl: what: a remark\nbvhctl: what: the end\n");
}

static void read_pipe(enum report_volume volume, char *ret_text, size_t size)
{
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    struct redirection redirection = redirect(ends[0], ends[1]);
    struct progress progress = {0};
    report_set_volume(volume);
    progress_begin(&progress, "importing", "x");
    progress_update(&progress, 4, 4);
    progress_end(&progress);
    report_note("what", "a remark");
    report_detail("what", "a detail");
    report_finding("what", "a finding");
    expect_text(redirection.from, "a finding\n", ret_text, size);
    restore(&redirection);
}

/* Elsewhere there are lines only when all is to be printed, and then they have no control characters. */
static void test_pipe(void **state)
{
    (void)state;
    char text[4096] = "";
    read_pipe(REPORT_ERRORS, text, sizeof text);
    assert_string_equal(text, "bvhctl: what: a finding\n");
    *text = '\0';
    read_pipe(REPORT_RESULTS, text, sizeof text);
    assert_string_equal(text, "bvhctl: what: a remark\nbvhctl: what: a finding\n");
    *text = '\0';
    read_pipe(REPORT_ALL, text, sizeof text);
    assert_non_null(strstr(text, "bvhctl: importing x: 100 %, "));
    assert_non_null(strstr(text, "bvhctl: what: a detail\n"));
    assert_null(strchr(text, '\033'));
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_terminal), cmocka_unit_test(test_pipe)};
    return cmocka_run_group_tests_name("progress", tests, NULL, NULL);
}
