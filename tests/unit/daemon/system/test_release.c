/* SPDX-License-Identifier: Apache-2.0 */
/* test_release.c - tests that mappings and descriptors are released, each once, without blocking the caller. */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "daemon/system/descriptors.h"
#include "daemon/system/release.h"
#include "tests/support/daemon/test_lingering.h"

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

static void wait_until_left(uint32_t count)
{
    for (int i = 0; i < 5000 && descriptors_left(&descriptors) < count; i++)
        usleep(1000);
    assert_int_equal(descriptors_left(&descriptors), count);
}

static void wait_until_all_is_closed(void)
{
    wait_until_left(LIMIT);
}

static void small_ones_are_released_at_once(void **state)
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

static void large_ones_are_released_soon(void **state)
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

/*
 * All descriptors are closed in the end, and none is closed twice: that would make the count negative, or close `mine`.
 */
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

enum { PUT_OFF = 3 };

static void *release_one(void *context)
{
    (void)context;
    release_memfd(make_file(LARGE), LARGE);
    return NULL;
}

/* Descriptors that another thread releases later are closed earlier. */
static void *release_and_flush(void *context)
{
    int files[PUT_OFF];
    pthread_t other;
    release_flush();
    for (int i = 0; i < PUT_OFF; i++)
        release_memfd(files[i] = make_file(LARGE), LARGE);
    assert_int_equal(pthread_create(&other, NULL, release_one, NULL), 0);
    pthread_join(other, NULL);
    wait_until_left(LIMIT - PUT_OFF);
    for (int i = 0; i < PUT_OFF; i++)
        assert_true(is_open(files[i]));
    int small = make_file(SMALL);
    release_memfd(small, SMALL);
    assert_false(is_open(small));
    release_flush();
    return context;
}

static void a_thread_may_put_off_its_releases(void **state)
{
    (void)state;
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, release_and_flush, NULL), 0);
    pthread_join(thread, NULL);
    wait_until_all_is_closed();
}

static volatile sig_atomic_t handled_by_main;
static pthread_t main_thread;

static void handle(int number)
{
    (void)number;
    handled_by_main = pthread_equal(pthread_self(), main_thread) ? 1 : -1;
}

/* While the main thread blocks a signal, the signal stays pending: the module's threads do not take it. */
static void no_signal_is_taken(void **state)
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

static void descriptors_of_clients_are_closed(void **state)
{
    (void)state;
    int pipes[2], small = make_file(10), large = make_file(LARGE);
    assert_int_equal(pipe2(pipes, O_CLOEXEC), 0);
    release_descriptor(NULL, small);
    assert_false(is_open(small));
    release_descriptor(NULL, large);
    release_descriptor(NULL, pipes[1]);
    char byte;
    assert_int_equal(read(pipes[0], &byte, 1), 0); /* the end of the stream: the writing side is closed */
    release_descriptor(NULL, pipes[0]);
    wait_until_all_is_closed();
    assert_false(is_open(large));
    assert_false(is_open(pipes[0]));
    release_descriptor(NULL, pipes[0]);
    release_descriptor(NULL, -1);
    assert_int_equal(descriptors_left(&descriptors), LIMIT);
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

/*
 * The file's st_size is one byte, but it has LARGE bytes of pages, so it must be closed later: it queues behind the
 * socket whose close() blocks the thread.
 */
static void the_size_is_that_of_the_pages(void **state)
{
    (void)state;
    struct test_lingering pair = {-1, -1};
    int descriptor = make_file(LARGE);
    if (!test_lingering_is_possible())
        skip();
    assert_true(test_lingering_make(&pair));
    release_memfd(pair.sender, LARGE);
    assert_int_equal(ftruncate(descriptor, 1), 0);
    assert_int_equal(fallocate(descriptor, FALLOC_FL_KEEP_SIZE, 0, LARGE), 0);
    release_descriptor(NULL, descriptor);
    assert_true(is_open(descriptor));
    assert_int_equal(descriptors_left(&descriptors), LIMIT - 2);
    test_lingering_end(&pair);
    wait_until_all_is_closed();
    assert_false(is_open(descriptor));
}

/*
 * Each close() would take a minute. Descriptors that are not closed yet are not counted as free; they are once their
 * peers have gone away.
 */
static void foreign_descriptors_block_nobody(void **state)
{
    (void)state;
    enum { COUNT = RELEASE_FOREIGN_THREADS + 10 };
    static struct test_lingering pairs[COUNT];
    if (!test_lingering_is_possible())
        skip();
    for (int i = 0; i < COUNT; i++)
        assert_true(test_lingering_make(&pairs[i]));
    double begun = seconds();
    for (int i = 0; i < COUNT; i++)
        release_descriptor(NULL, pairs[i].sender);
    assert_true(seconds() - begun < 20);
    assert_int_equal(descriptors_left(&descriptors), LIMIT - COUNT);
    int own = make_file(LARGE);
    release_memfd(own, LARGE);
    for (int i = 0; i < 5000 && descriptors_left(&descriptors) < LIMIT - COUNT; i++)
        usleep(1000);
    assert_false(is_open(own));
    assert_int_equal(descriptors_left(&descriptors), LIMIT - COUNT);
    for (int i = 0; i < COUNT; i++)
        test_lingering_end(&pairs[i]);
    wait_until_all_is_closed();
}

static void send_descriptor(int socket, int descriptor)
{
    union {
        struct cmsghdr head;
        char bytes[CMSG_SPACE(sizeof descriptor)];
    } control;
    struct iovec byte = {"x", 1};
    struct msghdr message = {
        .msg_iov = &byte, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    control.head =
        (struct cmsghdr){.cmsg_len = CMSG_LEN(sizeof descriptor), .cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS};
    memcpy(CMSG_DATA(&control.head), &descriptor, sizeof descriptor);
    assert_int_equal(sendmsg(socket, &message, 0), 1);
}

/* The last reference to the lingering socket is in a message that nobody has received. */
static void unread_descriptors_block_nobody(void **state)
{
    (void)state;
    struct test_lingering pair = {-1, -1};
    int ends[2];
    if (!test_lingering_is_possible())
        skip();
    assert_true(test_lingering_make(&pair));
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
    send_descriptor(ends[0], pair.sender);
    close(pair.sender);
    close(ends[0]);
    double begun = seconds();
    release_descriptor(NULL, ends[1]);
    assert_true(seconds() - begun < 20);
    assert_int_equal(descriptors_left(&descriptors), LIMIT - 1);
    test_lingering_end(&pair);
    wait_until_all_is_closed();
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(small_ones_are_released_at_once),
        cmocka_unit_test(large_ones_are_released_soon),
        cmocka_unit_test(any_thread_may_release),
        cmocka_unit_test(a_thread_may_put_off_its_releases),
        cmocka_unit_test(no_signal_is_taken),
        cmocka_unit_test(descriptors_of_clients_are_closed),
        cmocka_unit_test(the_size_is_that_of_the_pages),
        cmocka_unit_test(foreign_descriptors_block_nobody),
        cmocka_unit_test(unread_descriptors_block_nobody),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
