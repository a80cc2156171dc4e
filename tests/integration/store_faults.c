/* SPDX-License-Identifier: Apache-2.0 */
/*
 * store_faults.c - damages the files of a cache on disk, and kills processes that write it. No damaged entry may ever
 * be read, and nothing may need to be cleaned up by hand.
 *
 *     store_faults flips COUNT SEED    changes a random bit of an entry's file, or cuts it, COUNT times: each is found,
 *                                      and the entry is written again
 *     store_faults kills COUNT SEED    ends a writer with SIGKILL at a random time, COUNT times: what it has written is
 *                                      read or missing, and no unfinished file is left after the next scan
 */
#include "tests/support/unit.h"

#include <signal.h>
#include <sys/wait.h>

#include "tests/support/scratch.h"

#include "tests/support/builder/store_bed.h"

enum { ENTRIES = 64, MOST_US = 8000 };

static uint32_t count;
static struct random generator;

/* Sizes below and above a piece; some entries have no payload. */
static uint64_t random_size(void)
{
    static const uint64_t most[] = {1, 300, 5000, 70000, 300000};
    return random_next(&generator) % most[random_next(&generator) % 5];
}

static void flip_or_cut(uint32_t number)
{
    int file = bed_file(number, O_RDWR);
    struct stat about;
    assert_int_equal(fstat(file, &about), 0);
    uint64_t at = random_next(&generator) % (uint64_t)about.st_size;
    if (random_next(&generator) % 4 == 0) {
        assert_int_equal(ftruncate(file, (off_t)at), 0);
    } else {
        unsigned char byte;
        assert_int_equal(pread(file, &byte, 1, (off_t)at), 1);
        byte ^= (unsigned char)(1u << random_next(&generator) % 8);
        assert_int_equal(pwrite(file, &byte, 1, (off_t)at), 1);
    }
    close(file);
}

static void every_damage_is_found(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < ENTRIES; i++)
        bed_put(i, random_size());
    for (uint32_t i = 0; i < count; i++) {
        uint32_t number = (uint32_t)(random_next(&generator) % ENTRIES);
        flip_or_cut(number);
        assert_false(bed_has(number));
        assert_int_equal(store_state(bed_store).damaged, i + 1);
        bed_put(number, random_size());
        assert_true(bed_has(number));
    }
    for (uint32_t i = 0; i < ENTRIES; i++)
        assert_true(bed_has(i));
    print_message("%u damaged files: all found, all written again\n", count);
}

/* Writes entries until it is killed, and sometimes removes some. */
static void write_for_ever(void)
{
    struct bvhd_error error;
    for (;;) {
        bed_try_put((uint32_t)(random_next(&generator) % ENTRIES), random_size(), &error);
        if (random_next(&generator) % 16 == 0)
            store_trim_to(bed_store, 200000, &error);
    }
}

static void kill_a_writer(void)
{
    const long ns = (long)(random_next(&generator) % MOST_US) * 1000;
    pid_t writer = fork();
    assert_true(writer >= 0);
    if (writer == 0)
        write_for_ever();
    nanosleep(&(struct timespec){.tv_nsec = ns}, NULL);
    assert_int_equal(kill(writer, SIGKILL), 0);
    assert_int_equal(waitpid(writer, NULL, 0), writer);
}

static void a_killed_writer_leaves_whole_entries(void **state)
{
    (void)state;
    struct bvhd_error error;
    uint64_t read = 0;
    for (uint32_t i = 0; i < count; i++) {
        kill_a_writer();
        for (uint32_t number = 0; number < ENTRIES; number++)
            read += bed_has(number);
        assert_int_equal(store_state(bed_store).damaged, 0);
        assert_int_equal(store_scan(bed_store, &error), BVHD_OK);
        if (i % 50 == 0)
            assert_int_equal(bed_files(), store_state(bed_store).entries);
    }
    assert_int_equal(bed_files(), store_state(bed_store).entries);
    assert_true(read > 0);
    print_message("%u killed writers: %llu entries read, none damaged, nothing left over\n", count,
                  (unsigned long long)read);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest flips[] = {cmocka_unit_test_setup_teardown(every_damage_is_found, bed_begin, bed_end)};
    const struct CMUnitTest kills[] = {
        cmocka_unit_test_setup_teardown(a_killed_writer_leaves_whole_entries, bed_begin, bed_end)};
    if (argc != 4 || (strcmp(argv[1], "flips") != 0 && strcmp(argv[1], "kills") != 0)) {
        fprintf(stderr, "usage: store_faults flips|kills COUNT SEED\n");
        return 2;
    }
    count = (uint32_t)strtoul(argv[2], NULL, 10);
    generator.state = strtoull(argv[3], NULL, 10);
    return strcmp(argv[1], "flips") == 0 ? cmocka_run_group_tests(flips, NULL, NULL)
                                         : cmocka_run_group_tests(kills, NULL, NULL);
}
