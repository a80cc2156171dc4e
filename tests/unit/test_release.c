/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <sys/mman.h>
#include <unistd.h>

#include "descriptors.h"
#include "release.h"

enum { SMALL = RELEASE_LATER_MIN - 1, LARGE = RELEASE_LATER_MIN, LIMIT = 1000 };

static struct descriptors descriptors = {.limit = LIMIT};

static int make_file(uint64_t size)
{
    int descriptor = memfd_create("test", MFD_CLOEXEC);
    assert_true(descriptor >= 0);
    assert_int_equal(fallocate(descriptor, 0, 0, (off_t)size), 0);
    return descriptor;
}

static void *make_mapping(uint64_t size)
{
    void *mapping = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    assert_ptr_not_equal(mapping, MAP_FAILED);
    return mapping;
}

static bool is_mapped(void *address)
{
    return msync(address, 1, MS_ASYNC) == 0;
}

static bool is_open(int descriptor)
{
    return fcntl(descriptor, F_GETFD) >= 0;
}

static void wait_until_all_is_closed(void)
{
    for (int i = 0; i < 5000 && descriptors_left(&descriptors) < LIMIT; i++)
        usleep(1000);
    assert_int_equal(descriptors_left(&descriptors), LIMIT);
}

static void small_things_go_at_once(void **state)
{
    (void)state;
    int descriptor = make_file(SMALL);
    release_memfd(descriptor, SMALL);
    assert_false(is_open(descriptor));
    assert_int_equal(descriptors_left(&descriptors), LIMIT);
    void *mapping = make_mapping(SMALL);
    release_mapping(mapping, SMALL);
    assert_false(is_mapped(mapping));
}

static void large_things_go_soon(void **state)
{
    (void)state;
    int descriptor = make_file(LARGE);
    release_memfd(descriptor, LARGE);
    wait_until_all_is_closed();
    assert_false(is_open(descriptor));
    void *mapping = make_mapping(LARGE);
    release_mapping(mapping, LARGE);
    for (int i = 0; i < 5000 && is_mapped(mapping); i++)
        usleep(1000);
    assert_false(is_mapped(mapping));
}

enum { THREADS = 4, ROUNDS = 50 };

static void *release_many(void *context)
{
    (void)context;
    for (int i = 0; i < ROUNDS; i++) {
        release_memfd(make_file(LARGE), LARGE);
        release_mapping(make_mapping(4 << 20), 4 << 20);
    }
    return NULL;
}

/* All are closed in the end, and none is closed twice: a count would be below zero, or somebody else's descriptor gone. */
static void any_thread_may_release(void **state)
{
    (void)state;
    int mine = make_file(1);
    pthread_t threads[THREADS];
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, release_many, NULL), 0);
    for (int i = 0; i < THREADS; i++)
        pthread_join(threads[i], NULL);
    wait_until_all_is_closed();
    int next = make_file(1);
    assert_int_equal(next, mine + 1);
    assert_true(is_open(mine));
    close(mine);
    close(next);
}

static volatile sig_atomic_t handled_by_main;
static pthread_t main_thread;

static void handle(int number)
{
    (void)number;
    handled_by_main = pthread_equal(pthread_self(), main_thread) ? 1 : -1;
}

/* With every other thread's signals blocked, one that is sent to the process waits for them: the module's own takes none. */
static void signals_are_for_others(void **state)
{
    (void)state;
    sigset_t usr1, before;
    main_thread = pthread_self();
    release_memfd(make_file(LARGE), LARGE);
    wait_until_all_is_closed();
    struct sigaction action = {.sa_handler = handle}, old;
    sigaction(SIGUSR1, &action, &old);
    sigemptyset(&usr1);
    sigaddset(&usr1, SIGUSR1);
    pthread_sigmask(SIG_BLOCK, &usr1, &before);
    kill(getpid(), SIGUSR1);
    usleep(20000);
    assert_int_equal(handled_by_main, 0);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    assert_int_equal(handled_by_main, 1);
    sigaction(SIGUSR1, &old, NULL);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(small_things_go_at_once),
        cmocka_unit_test(large_things_go_soon),
        cmocka_unit_test(any_thread_may_release),
        cmocka_unit_test(signals_are_for_others),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
