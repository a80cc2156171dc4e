/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_log_journal.c - tests that log lines carry a journal's priorities. It is a program of its own, because log.c
 * finds out only once in a process whether stderr is connected to a journal.
 */
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/support/unit.h"

#include "daemon/system/log.h"

static void test_priorities(void **state)
{
    char stream[64], text[1000];
    struct stat about;
    (void)state;
    int file = memfd_create("log", MFD_CLOEXEC), kept = dup(STDERR_FILENO);
    assert_true(file >= 0 && kept >= 0 && dup2(file, STDERR_FILENO) >= 0);
    fstat(file, &about);
    snprintf(stream, sizeof stream, "%llu:%llu", (unsigned long long)about.st_dev, (unsigned long long)about.st_ino);
    setenv("JOURNAL_STREAM", stream, 1);
    log_set_level(LOG_DEBUG);
    log_event(LOG_ERROR, "e", "a=1");
    log_event(LOG_WARNING, "w", NULL);
    log_event(LOG_INFO, "i", NULL);
    log_event(LOG_DEBUG, "d", NULL);
    dup2(kept, STDERR_FILENO);
    ssize_t size = pread(file, text, sizeof text - 1, 0);
    assert_true(size >= 0);
    text[size] = 0;
    assert_string_equal(
        text, "<3>level=error event=e a=1\n<4>level=warning event=w\n<6>level=info event=i\n<7>level=debug event=d\n");
    close(file);
    close(kept);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_priorities)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
