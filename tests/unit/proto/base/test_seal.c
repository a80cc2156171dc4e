/* SPDX-License-Identifier: Apache-2.0 */
/* test_seal.c - tests that sealing waits for writers for a while, and returns other errors at once. */
#include "tests/support/unit.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "proto/base/clock.h"
#include "proto/base/seal.h"

enum { SIZE = 65536, SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL };

struct file {
    int descriptor;
    void *mapping;
};

static struct file file_open(void)
{
    struct file file = {.descriptor = memfd_create("seal", MFD_CLOEXEC | MFD_ALLOW_SEALING)};
    assert_true(file.descriptor >= 0);
    assert_int_equal(ftruncate(file.descriptor, SIZE), 0);
    file.mapping = mmap(NULL, SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, file.descriptor, 0);
    assert_true(file.mapping != MAP_FAILED);
    return file;
}

static void *unmap_soon(void *mapping)
{
    nanosleep(&(struct timespec){.tv_nsec = 20000000}, NULL);
    munmap(mapping, SIZE);
    return NULL;
}

static void test_waits_until_nobody_writes(void **state)
{
    (void)state;
    struct file file = file_open();
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, unmap_soon, file.mapping), 0);
    assert_int_equal(seal_add(file.descriptor, SEALS), 0);
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_int_equal(fcntl(file.descriptor, F_GET_SEALS), SEALS);
    close(file.descriptor);
}

static void test_does_not_wait_for_ever(void **state)
{
    (void)state;
    struct file file = file_open();
    double begin = clock_ms();
    assert_int_equal(seal_add(file.descriptor, SEALS), -1);
    assert_int_equal(errno, EBUSY);
    assert_true(clock_ms() - begin >= SEAL_PATIENCE_MS);
    assert_int_equal(fcntl(file.descriptor, F_GET_SEALS), 0);
    munmap(file.mapping, SIZE);
    close(file.descriptor);
}

static void test_other_errors_end_it(void **state)
{
    (void)state;
    double begin = clock_ms();
    assert_int_equal(seal_add(-1, SEALS), -1);
    assert_int_equal(errno, EBADF);
    assert_true(clock_ms() - begin < SEAL_PATIENCE_MS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_waits_until_nobody_writes),
        cmocka_unit_test(test_does_not_wait_for_ever),
        cmocka_unit_test(test_other_errors_end_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
