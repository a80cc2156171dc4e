/* SPDX-License-Identifier: Apache-2.0 */
/* test_interrupt.c - tests that a signal ends the process, but not before its half-written file is removed. */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "client/bvhctl/base/interrupt.h"
#include "tests/support/scratch.h"

enum { PATIENCE_S = 60 };

struct outcome {
    int status;
    char printed[512], told[512];
};

static void read_text(int descriptor, char *ret_text, size_t size)
{
    size_t used = 0;
    for (ssize_t got = 1; got > 0; used += got > 0 ? (size_t)got : 0)
        got = read(descriptor, ret_text + used, size - 1 - used);
    ret_text[used] = '\0';
    close(descriptor);
}

/* Runs `work` in a child, and returns how it ended, and what it wrote. */
static struct outcome run_child(void (*work)(void))
{
    struct outcome outcome;
    int out[2], messages[2];
    assert_int_equal(pipe(out), 0);
    assert_int_equal(pipe(messages), 0);
    pid_t child = fork();
    if (child == 0) {
        dup2(out[1], STDOUT_FILENO);
        dup2(messages[1], STDERR_FILENO);
        close(out[1]);
        close(messages[1]);
        alarm(PATIENCE_S);
        work();
        _exit(0);
    }
    close(out[1]);
    close(messages[1]);
    read_text(out[0], outcome.printed, sizeof outcome.printed);
    read_text(messages[0], outcome.told, sizeof outcome.told);
    assert_int_equal(waitpid(child, &outcome.status, 0), child);
    return outcome;
}

static void create(const char *path)
{
    int descriptor = open(path, O_CREAT | O_WRONLY, 0600);
    if (descriptor >= 0)
        close(descriptor);
}

static void raise_with_file(void)
{
    interrupt_watch("build", true);
    create("whole");
    interrupt_removes("part");
    create("part");
    raise(SIGINT);
}

static void test_file(void **state)
{
    (void)state;
    struct outcome outcome = run_child(raise_with_file);
    assert_true(WIFSIGNALED(outcome.status));
    assert_int_equal(WTERMSIG(outcome.status), SIGINT);
    assert_int_not_equal(access("part", F_OK), 0);
    assert_int_equal(access("whole", F_OK), 0);
    assert_string_equal(outcome.told, "bvhctl: build: signal: interrupted\n");
    assert_non_null(strstr(outcome.printed, "{\"schema\":1,\"error\":{\"status\":\"CANCELLED\""));
}

static void raise_after_output(void)
{
    interrupt_watch("check", true);
    interrupt_removes("renamed");
    create("renamed");
    interrupt_removes(NULL);
    interrupt_output_begins();
    raise(SIGTERM);
}

static void test_after_output(void **state)
{
    (void)state;
    struct outcome outcome = run_child(raise_after_output);
    assert_true(WIFSIGNALED(outcome.status));
    assert_int_equal(WTERMSIG(outcome.status), SIGTERM);
    assert_int_equal(access("renamed", F_OK), 0);
    assert_string_equal(outcome.printed, "");
}

static void *raise_here(void *unused)
{
    pthread_kill(pthread_self(), SIGINT);
    return unused;
}

/* The signal comes to another thread than the main one. */
static void raise_in_thread(void)
{
    pthread_t thread;
    interrupt_watch("trace", false);
    interrupt_removes("other");
    create("other");
    if (pthread_create(&thread, NULL, raise_here, NULL) == 0)
        pthread_join(thread, NULL);
    pause();
}

static void test_thread(void **state)
{
    (void)state;
    struct outcome outcome = run_child(raise_in_thread);
    assert_true(WIFSIGNALED(outcome.status));
    assert_int_equal(WTERMSIG(outcome.status), SIGINT);
    assert_int_not_equal(access("other", F_OK), 0);
    assert_string_equal(outcome.told, "bvhctl: trace: signal: interrupted\n");
    assert_string_equal(outcome.printed, "");
}

static void raise_ignored(void)
{
    signal(SIGINT, SIG_IGN);
    interrupt_watch("build", false);
    raise(SIGINT);
}

static void test_ignored(void **state)
{
    (void)state;
    struct outcome outcome = run_child(raise_ignored);
    assert_true(WIFEXITED(outcome.status));
    assert_int_equal(WEXITSTATUS(outcome.status), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_file),
        cmocka_unit_test(test_after_output),
        cmocka_unit_test(test_thread),
        cmocka_unit_test(test_ignored),
    };
    return cmocka_run_group_tests_name("interrupt", tests, scratch_enter, scratch_remove);
}
