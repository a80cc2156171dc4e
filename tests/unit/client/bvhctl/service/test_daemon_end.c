/* SPDX-License-Identifier: Apache-2.0 */
/* test_daemon_end.c - tests which processes are ended, by children that listen as a daemon does. */
#include "tests/support/unit.h"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include "client/bvhctl/service/daemon_end.h"
#include "tests/support/scratch.h"

static const char path[] = "listener.sock";

/* Starts a process of that name that listens, and returns when it does. */
static pid_t listen_as(const char *name, bool ignores)
{
    int ready[2];
    char byte;
    unlink(path);
    assert_int_equal(pipe(ready), 0);
    pid_t child = fork();
    if (child == 0) {
        struct sockaddr_un address = {.sun_family = AF_UNIX};
        memcpy(address.sun_path, path, sizeof path);
        int listener = socket(AF_UNIX, SOCK_STREAM, 0);
        prctl(PR_SET_NAME, name);
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        signal(SIGTERM, ignores ? SIG_IGN : SIG_DFL);
        if (bind(listener, (struct sockaddr *)&address, sizeof address) || listen(listener, 4) ||
            write(ready[1], "!", 1) != 1)
            _exit(1);
        for (;;)
            pause();
    }
    close(ready[1]);
    assert_int_equal(read(ready[0], &byte, 1), 1);
    close(ready[0]);
    return child;
}

static int end_child(pid_t child)
{
    int status;
    kill(child, SIGKILL);
    assert_int_equal(waitpid(child, &status, 0), child);
    return WTERMSIG(status);
}

static void test_daemon(void **state)
{
    (void)state;
    pid_t child = listen_as("bvhd", false), ended = 0;
    struct bvhd_error error = {0};
    if (daemon_end(path, 60000, &ended, &error) != BVHD_OK)
        fail_msg("%s", error.text);
    assert_int_equal(ended, child);
    assert_int_equal(end_child(child), SIGTERM);
    assert_int_equal(daemon_end(path, 60000, &ended, &error), BVHD_UNAVAILABLE);
}

static void test_busy(void **state)
{
    (void)state;
    pid_t child = listen_as("bvhd", true), ended = 0;
    struct bvhd_error error = {0};
    assert_int_equal(daemon_end(path, 10, &ended, &error), BVHD_BUSY);
    assert_string_equal(error.where, path);
    assert_int_equal(ended, 0);
    assert_int_equal(end_child(child), SIGKILL);
}

/* A service manager that listens for its daemon is not sent a signal. */
static void test_others(void **state)
{
    (void)state;
    pid_t child = listen_as("systemd", false), ended = 0;
    struct bvhd_error error = {0};
    assert_int_equal(daemon_end(path, 60000, &ended, &error), BVHD_UNSUPPORTED);
    assert_non_null(strstr(error.text, "(systemd) listens there, which is no bvhd"));
    assert_non_null(strstr(error.text, "stop bvhd.socket bvhd.service"));
    assert_int_equal(ended, 0);
    assert_int_equal(end_child(child), SIGKILL);
}

static void test_nobody(void **state)
{
    (void)state;
    pid_t ended = 0;
    struct bvhd_error error = {0};
    assert_int_equal(daemon_end("none.sock", 10, &ended, &error), BVHD_UNAVAILABLE);
    assert_string_equal(error.where, "none.sock");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_daemon),
        cmocka_unit_test(test_busy),
        cmocka_unit_test(test_others),
        cmocka_unit_test(test_nobody),
    };
    return cmocka_run_group_tests_name("daemon_end", tests, scratch_enter, scratch_remove);
}
