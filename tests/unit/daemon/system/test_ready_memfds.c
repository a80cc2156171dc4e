/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_ready_memfds.c - tests that memfds become ready in the sizes that were missing, within their budget, with all
 * their pages, and that none stays.
 */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <pthread.h>
#include <stdbool.h>
#include <sys/stat.h>
#include <unistd.h>

#include "daemon/system/ready_memfds.h"
#include "tests/support/random.h"

enum { LIMIT = 1000, SIZE = 300000, BUDGET = 1 << 20, WAIT_MS = 60000, NEVER_MS = 1000000 };

static struct memory memory;
static struct descriptors descriptors;
static struct ready_memfds *ready;

static int set_up(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    descriptors = (struct descriptors){.limit = LIMIT};
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    ready_memfds_destroy(ready);
    ready = NULL;
    return memory.live == 0 && descriptors.used == 0 ? 0 : -1;
}

/* While a thread reads, nothing is prepared. */
static void create(unsigned idle_ms)
{
    const struct ready_options options = {
        .memory = &memory, .descriptors = &descriptors, .budget = BUDGET, .idle_ms = idle_ms};
    assert_int_equal(ready_memfds_create(&options, &ready, NULL), BVHD_OK);
}

/* Asks for memfds that are not there, as one reader does. */
static void miss(uint64_t size, int count)
{
    struct memfd memfd;
    ready_memfds_enter(ready);
    for (int i = 0; i < count; i++)
        assert_false(ready_memfds_take(ready, size, &memfd));
    ready_memfds_leave(ready);
    ready_memfds_prepare(ready);
}

/* Waits until all that was wanted has been prepared or dropped. */
static void await(uint32_t count, uint64_t bytes)
{
    struct ready_load load = {0};
    for (int i = 0; i < WAIT_MS; i++) {
        load = ready_memfds_load(ready);
        if (load.wanted == 0 && load.count == count && load.bytes == bytes)
            return;
        usleep(1000);
    }
    fail_msg("%u memfds of %llu bytes", load.count, (unsigned long long)load.bytes);
}

static void finish(const struct memfd *memfd)
{
    memfd_unmap(memfd);
    assert_int_equal(close(memfd->descriptor), 0);
}

static void expect_usable(const struct memfd *memfd, uint64_t size)
{
    struct stat file;
    assert_true(memfd->size >= size && memfd->size < 2 * size);
    assert_int_equal(fstat(memfd->descriptor, &file), 0);
    assert_int_equal(file.st_size, memfd->size);
    assert_int_equal(lseek(memfd->descriptor, 0, SEEK_HOLE), memfd->size);
    assert_true((uint64_t)file.st_blocks * 512 >= memfd->size);
    for (uint64_t at = 0; at < memfd->size; at++)
        assert_int_equal(memfd->bytes[at], 0);
    memset(memfd->bytes, 1, memfd->size);
    unsigned char last = 0;
    assert_int_equal(pread(memfd->descriptor, &last, 1, (off_t)memfd->size - 1), 1);
    assert_int_equal(last, 1);
}

static void what_was_missing_becomes_ready(void **state)
{
    (void)state;
    struct memfd memfd;
    create(NEVER_MS);
    miss(SIZE, 3);
    await(3, 3 * UINT64_C(327680)); /* with an eighth of 2^18 as the step */
    assert_int_equal(descriptors.used, 3);
    ready_memfds_enter(ready);
    assert_false(ready_memfds_take(ready, SIZE / 2, &memfd)); /* twice as long */
    assert_false(ready_memfds_take(ready, 327681, &memfd));
    for (uint32_t left = 3; left-- > 0;) {
        assert_true(ready_memfds_take(ready, left == 0 ? 327680 : SIZE, &memfd));
        assert_int_equal(ready_memfds_load(ready).count, left);
        assert_int_equal(descriptors.used, left);
        expect_usable(&memfd, SIZE);
        finish(&memfd);
    }
    assert_false(ready_memfds_take(ready, SIZE, &memfd));
    ready_memfds_leave(ready);
}

static void the_smallest_that_serves_is_taken(void **state)
{
    (void)state;
    struct memfd memfd;
    create(NEVER_MS);
    miss(262144, 1);
    await(1, 262144);
    ready_memfds_enter(ready);
    assert_false(ready_memfds_take(ready, 400000, &memfd));
    ready_memfds_leave(ready);
    ready_memfds_prepare(ready);
    await(2, 262144 + 425984);
    ready_memfds_enter(ready);
    assert_true(ready_memfds_take(ready, 250000, &memfd));
    assert_int_equal(memfd.size, 262144);
    finish(&memfd);
    assert_true(ready_memfds_take(ready, 250000, &memfd));
    assert_int_equal(memfd.size, 425984);
    finish(&memfd);
    ready_memfds_leave(ready);
}

static void small_and_absurd_sizes_are_never_ready(void **state)
{
    (void)state;
    static const uint64_t sizes[] = {0, 1, READY_SIZE_MIN - 1, BUDGET + 1, INT64_MAX, UINT64_MAX};
    create(NEVER_MS);
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        miss(sizes[i], 2);
    miss(READY_SIZE_MIN, 1);
    await(1, READY_SIZE_MIN);
}

static void they_stay_within_the_budget(void **state)
{
    (void)state;
    create(NEVER_MS);
    miss(SIZE, 2 * READY_MOST);
    await(3, 3 * UINT64_C(327680));
    miss(700000, 1); /* the oldest leave to make room */
    await(2, 327680 + 720896);
    ready_memfds_destroy(ready);
    ready = NULL;
    assert_true(memory.peak <= BUDGET + 16384);
}

static void descriptors_may_be_short(void **state)
{
    (void)state;
    descriptors.limit = DESCRIPTORS_RESERVE + 1;
    create(NEVER_MS);
    miss(SIZE, 3);
    await(1, 327680);
    miss(700000, 1);
    await(1, 720896);
    assert_int_equal(descriptors.used, 1);
}

static void all_are_given_back_when_nobody_asks(void **state)
{
    (void)state;
    create(1);
    miss(SIZE, 1);
    for (int i = 0; i < WAIT_MS && memory.peak < SIZE; i++)
        usleep(1000);
    assert_true(memory.peak >= SIZE);
    await(0, 0);
    miss(SIZE, 1);
    await(0, 0);
}

static void without_memory_there_are_none(void **state)
{
    (void)state;
    const struct ready_options options = {.memory = &memory, .descriptors = &descriptors};
    struct bvhd_error error;
    memory.fail_after = 0;
    assert_int_equal(ready_memfds_create(&options, &ready, &error), BVHD_NO_MEMORY);
    assert_null(ready);
}

enum { THREADS = 4, TURNS = 100 };

static void *read_often(void *context)
{
    struct random random = {*(uint64_t *)context};
    for (int i = 0; i < TURNS; i++) {
        struct memfd memfd;
        uint64_t size = READY_SIZE_MIN + random_next(&random) % (4 * READY_SIZE_MIN);
        ready_memfds_enter(ready);
        if (ready_memfds_take(ready, size, &memfd)) {
            memfd.bytes[0] = memfd.bytes[size - 1] = 1;
            memfd_unmap(&memfd);
            close(memfd.descriptor);
        }
        ready_memfds_leave(ready);
        ready_memfds_prepare(ready);
    }
    return NULL;
}

static void any_thread_may_read(void **state)
{
    (void)state;
    pthread_t threads[THREADS];
    uint64_t seeds[THREADS];
    create(1);
    for (uint64_t i = 0; i < THREADS; i++) {
        seeds[i] = i + 1;
        assert_int_equal(pthread_create(&threads[i], NULL, read_often, &seeds[i]), 0);
    }
    for (int i = 0; i < THREADS; i++)
        pthread_join(threads[i], NULL);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_was_missing_becomes_ready, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_smallest_that_serves_is_taken, set_up, tear_down),
        cmocka_unit_test_setup_teardown(small_and_absurd_sizes_are_never_ready, set_up, tear_down),
        cmocka_unit_test_setup_teardown(they_stay_within_the_budget, set_up, tear_down),
        cmocka_unit_test_setup_teardown(descriptors_may_be_short, set_up, tear_down),
        cmocka_unit_test_setup_teardown(all_are_given_back_when_nobody_asks, set_up, tear_down),
        cmocka_unit_test_setup_teardown(without_memory_there_are_none, set_up, tear_down),
        cmocka_unit_test_setup_teardown(any_thread_may_read, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
