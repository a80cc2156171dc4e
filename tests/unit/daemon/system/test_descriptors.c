/* SPDX-License-Identifier: Apache-2.0 */
/* test_descriptors.c - tests that the count of descriptors agrees with the system, and that no limit is exceeded. */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <pthread.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "daemon/system/descriptors.h"

/* Returns what descriptors_init would give, but with the limit that the test asks for. */
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

static void open_descriptors_are_not_free(void **state)
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

/*
 * The count runs out exactly when the system does: every descriptor that descriptors_take grants can be opened, and the
 * next one cannot. The test lowers the hard limit, so it runs in a child process.
 */
static void the_count_agrees_with_the_system(void **state)
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

/* A parent can hand down more open descriptors than the limit allows. Then none are left, and no count wraps round. */
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
        _exit(descriptors_left(&descriptors) == 0 && !descriptors_take(&descriptors, 1, 0) &&
                      !descriptors_send(&descriptors, 1)
                  ? 0
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

static void lingering_descriptors_are_not_free(void **state)
{
    (void)state;
    struct descriptors descriptors = with_limit(10), full = with_limit(3);
    assert_true(descriptors_take(&full, 3, 0));
    descriptors_linger();
    descriptors_linger();
    assert_int_equal(descriptors_left(&descriptors), 8);
    assert_int_equal(descriptors_left(&full), 0);
    assert_false(descriptors_take(&full, 0, 0));
    assert_true(descriptors_take(&descriptors, 5, 3));
    assert_false(descriptors_take(&descriptors, 1, 3));
    assert_int_equal(descriptors_left(&descriptors), 3);
    descriptors_lingered();
    assert_true(descriptors_take(&descriptors, 1, 3));
    descriptors_lingered();
    assert_int_equal(descriptors_left(&descriptors), 4);
    assert_int_equal(descriptors_left(&full), 0);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_soft_limit_is_raised),
        cmocka_unit_test(open_descriptors_are_not_free),
        cmocka_unit_test(the_count_agrees_with_the_system),
        cmocka_unit_test(a_limit_below_what_is_open_leaves_none),
        cmocka_unit_test(taking_keeps_some_free),
        cmocka_unit_test(all_or_none),
        cmocka_unit_test(half_may_be_unread),
        cmocka_unit_test(threads_share_the_limit),
        cmocka_unit_test(lingering_descriptors_are_not_free),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
