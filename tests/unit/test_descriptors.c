/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "descriptors.h"

/* As after descriptors_init, with a limit of the test's own. */
static struct descriptors with_limit(uint32_t limit)
{
    return (struct descriptors){.limit = limit};
}

static struct rlimit limit_now(void)
{
    struct rlimit limit;
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    return limit;
}

static void the_soft_limit_is_raised(void **state)
{
    (void)state;
    struct rlimit before = limit_now();
    assert_true(before.rlim_max > 64);
    struct rlimit low = {.rlim_cur = 64, .rlim_max = before.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &low), 0);
    struct descriptors descriptors;
    descriptors_init(&descriptors);
    assert_int_equal(limit_now().rlim_cur, before.rlim_max);
    if (before.rlim_max <= UINT32_MAX)
        assert_true(descriptors.limit < before.rlim_max && descriptors.limit + 64 > before.rlim_max);
    assert_int_equal(descriptors_left(&descriptors), descriptors.limit);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &before), 0);
}

static void what_is_open_is_not_free(void **state)
{
    (void)state;
    struct descriptors before, after;
    descriptors_init(&before);
    int opened[5];
    for (int i = 0; i < 5; i++)
        opened[i] = open("/dev/null", O_RDONLY | O_CLOEXEC);
    descriptors_init(&after);
    assert_int_equal(before.limit - after.limit, 5);
    for (int i = 0; i < 5; i++)
        close(opened[i]);
    descriptors_init(&after);
    assert_int_equal(before.limit, after.limit);
}

static int lower_hard_limit(uint32_t limit)
{
    struct rlimit low = {.rlim_cur = limit, .rlim_max = limit};
    return setrlimit(RLIMIT_NOFILE, &low);
}

/* Counted before the system says no: with everything taken that is said to be left, opening fails for the first time. In a process of its own. */
static void the_count_is_the_systems(void **state)
{
    (void)state;
    pid_t child = fork();
    if (child == 0) {
        struct descriptors descriptors;
        if (lower_hard_limit(100) != 0)
            _exit(2);
        descriptors_init(&descriptors);
        while (descriptors_take(&descriptors, 1, 0))
            if (open("/dev/null", O_RDONLY) < 0)
                _exit(3);
        _exit(open("/dev/null", O_RDONLY) < 0 ? 0 : 4);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
}

/* A parent may hand down more than the limit allows: nothing is left, and nothing wraps round. */
static void a_limit_below_what_is_open_leaves_none(void **state)
{
    (void)state;
    pid_t child = fork();
    if (child == 0) {
        struct descriptors descriptors;
        for (int i = 0; i < 20; i++)
            open("/dev/null", O_RDONLY);
        if (lower_hard_limit(10) != 0)
            _exit(2);
        descriptors_init(&descriptors);
        _exit(descriptors_left(&descriptors) == 0 && !descriptors_take(&descriptors, 1, 0) && !descriptors_send(&descriptors, 1) ? 0
                                                                                                                                 : 3);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
}

static void taking_keeps_some_free(void **state)
{
    (void)state;
    struct descriptors descriptors = with_limit(20);
    assert_false(descriptors_take(&descriptors, 5, 16));
    assert_true(descriptors_take(&descriptors, 4, 16));
    assert_int_equal(descriptors_left(&descriptors), 16);
    assert_false(descriptors_take(&descriptors, 1, 16));
    assert_true(descriptors_take(&descriptors, 0, 16));
    assert_true(descriptors_take(&descriptors, 16, 0));
    assert_int_equal(descriptors_left(&descriptors), 0);
    assert_false(descriptors_take(&descriptors, 1, 0));
    descriptors_give(&descriptors, 17);
    assert_int_equal(descriptors_left(&descriptors), 17);
    assert_true(descriptors_take(&descriptors, 1, 16));
    descriptors_give(&descriptors, 4);
    assert_int_equal(descriptors_left(&descriptors), 20);
}

static void all_or_none(void **state)
{
    (void)state;
    struct descriptors descriptors = with_limit(20);
    assert_false(descriptors_take(&descriptors, 21, 0));
    assert_int_equal(descriptors_left(&descriptors), 20);
    assert_false(descriptors_take(&descriptors, UINT32_MAX, 0));
    assert_false(descriptors_take(&descriptors, 1, UINT32_MAX));
    assert_false(descriptors_take(&descriptors, UINT32_MAX, UINT32_MAX));
    assert_false(descriptors_take(&descriptors, 0, 21));
    assert_int_equal(descriptors_left(&descriptors), 20);
    struct descriptors wide = with_limit(UINT32_MAX);
    assert_true(descriptors_take(&wide, UINT32_MAX, 0));
    assert_false(descriptors_take(&wide, 1, 0));
    assert_false(descriptors_take(&wide, UINT32_MAX, 0)); /* the sum wraps round in 32 bits */
}

static void half_may_be_unread(void **state)
{
    (void)state;
    struct descriptors descriptors = with_limit(21);
    assert_true(descriptors_send(&descriptors, 4));
    assert_true(descriptors_send(&descriptors, 6));
    assert_false(descriptors_send(&descriptors, 1));
    assert_true(descriptors_send(&descriptors, 0));
    assert_int_equal(descriptors_left(&descriptors), 21); /* sending opens nothing */
    descriptors_read(&descriptors, 2);
    assert_false(descriptors_send(&descriptors, 3));
    assert_true(descriptors_send(&descriptors, 2));
    assert_false(descriptors_send(&descriptors, UINT32_MAX));
    descriptors_read(&descriptors, 10);
    assert_int_equal(descriptors.unread, 0);
}

enum { THREADS = 4, ROUNDS = 20000, LIMIT = 5 };

struct crowd {
    struct descriptors descriptors;
    _Atomic uint32_t held, passed;
};

static void *take_and_give(void *context)
{
    struct crowd *crowd = context;
    for (int i = 0; i < ROUNDS; i++) {
        if (!descriptors_take(&crowd->descriptors, 2, 0))
            continue;
        if (atomic_fetch_add(&crowd->held, 2) + 2 > LIMIT)
            atomic_fetch_add(&crowd->passed, 1);
        atomic_fetch_sub(&crowd->held, 2);
        descriptors_give(&crowd->descriptors, 2);
    }
    return NULL;
}

static void threads_share_the_limit(void **state)
{
    (void)state;
    struct crowd crowd = {.descriptors = with_limit(LIMIT)};
    pthread_t threads[THREADS];
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, take_and_give, &crowd), 0);
    for (int i = 0; i < THREADS; i++)
        pthread_join(threads[i], NULL);
    assert_int_equal(crowd.passed, 0);
    assert_int_equal(descriptors_left(&crowd.descriptors), LIMIT);
}

static uint32_t left_after_all_is_closed(const struct descriptors *descriptors, uint32_t expected)
{
    for (int i = 0; i < 2000 && descriptors_left(descriptors) != expected; i++)
        usleep(1000);
    return descriptors_left(descriptors);
}

static void closing_closes(void **state)
{
    (void)state;
    struct descriptors descriptors = with_limit(100);
    int memfd = memfd_create("test", MFD_CLOEXEC), pipes[2];
    assert_int_equal(pipe(pipes), 0);
    descriptors_close(memfd);
    assert_int_equal(fcntl(memfd, F_GETFD), -1);
    descriptors_close(pipes[1]);
    char byte;
    assert_int_equal(read(pipes[0], &byte, 1), 0); /* the end of the file: nobody holds the other end */
    descriptors_close(pipes[0]);
    assert_int_equal(left_after_all_is_closed(&descriptors, 100), 100);
    assert_int_equal(fcntl(pipes[0], F_GETFD), -1);
    descriptors_close(-1);
    descriptors_close(pipes[0]);
    assert_int_equal(descriptors_left(&descriptors), 100);
}

/* A connected socket with more to send than its peer takes, and the wish to wait for that at its end. False without a network of its own. */
static bool make_lingering_pair(int ret_pair[2])
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof address;
    int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    ret_pair[0] = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (bind(listener, (struct sockaddr *)&address, length) != 0 || listen(listener, 1) != 0 ||
        getsockname(listener, (struct sockaddr *)&address, &length) != 0 ||
        connect(ret_pair[0], (struct sockaddr *)&address, length) != 0) {
        close(listener);
        close(ret_pair[0]);
        return false;
    }
    ret_pair[1] = accept(listener, NULL, NULL);
    assert_true(ret_pair[1] >= 0);
    close(listener);
    struct linger wait = {.l_onoff = 1, .l_linger = 60};
    assert_int_equal(setsockopt(ret_pair[0], SOL_SOCKET, SO_LINGER, &wait, sizeof wait), 0);
    static char block[1 << 16];
    while (send(ret_pair[0], block, sizeof block, MSG_DONTWAIT) > 0)
        ;
    return true;
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

/* close() would take a minute. What is not closed yet is not free; once the peer goes away, it is. */
static void closing_does_not_wait(void **state)
{
    (void)state;
    struct descriptors descriptors = with_limit(10), full = with_limit(3);
    int pair[2] = {-1, -1};
    if (!make_lingering_pair(pair)) {
        print_message("no sockets on the loopback interface here\n");
        skip();
    }
    assert_true(descriptors_take(&full, 3, 0));
    double begun = seconds();
    descriptors_close(pair[0]);
    assert_true(seconds() - begun < 10);
    assert_int_equal(descriptors_left(&descriptors), 9);
    assert_int_equal(descriptors_left(&full), 0);
    assert_true(descriptors_take(&descriptors, 5, 4));
    assert_false(descriptors_take(&descriptors, 1, 4));
    assert_int_equal(descriptors_left(&descriptors), 4);
    struct linger never = {.l_onoff = 1};
    assert_int_equal(setsockopt(pair[1], SOL_SOCKET, SO_LINGER, &never, sizeof never), 0);
    close(pair[1]);
    assert_int_equal(left_after_all_is_closed(&descriptors, 5), 5);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_soft_limit_is_raised), cmocka_unit_test(what_is_open_is_not_free),
        cmocka_unit_test(the_count_is_the_systems), cmocka_unit_test(a_limit_below_what_is_open_leaves_none),
        cmocka_unit_test(taking_keeps_some_free),   cmocka_unit_test(all_or_none),
        cmocka_unit_test(half_may_be_unread),       cmocka_unit_test(threads_share_the_limit),
        cmocka_unit_test(closing_closes),           cmocka_unit_test(closing_does_not_wait),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
