/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fault_machine.c - tests what a daemon does when the machine around it misbehaves. Whatever happens, each reply has
 * the right bytes, and when it is over, everything is as before.
 *
 *     fault_machine BVHD SHIM [--cycles N] [--seed N] [TEST...]
 *
 *     full           no write finds room: what is kept is served, and results are kept again soon after there is room
 *     small-disk     the same on a file system that is really full; needs the right to mount one
 *     descriptors    the process gets no further descriptors
 *     flips          N bits of cached files change, or files are cut, while the daemon runs
 *     clock          the time of day jumps, and files have times in the future
 *     versions       the cache has entries of another generation and of a newer format
 *     half-open      clients stop in the middle of what they send, or end one direction of their connection
 */
#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "proto/base/key.h"
#include "tests/support/daemon/fault_bed.h"

enum { SMALL = 24, MIDDLE = 8, KEPT = 6, PATIENCE_MS = 10000, SOON_MS = 1000 };

static struct fault_bed bed;
static struct fault_options options;

static void begin(const char *memory_bytes)
{
    static const char *const more[] = {"--disk-cache-size", "64M", "--log-level", "error", NULL};
    fault_bed_init(&bed, &options, memory_bytes, more);
}

static int end(void)
{
    int failures = fault_bed_end(&bed);
    fault_bed_remove(&bed);
    return failures;
}

/* Requests a mesh, and waits until its result is on disk. */
static struct key keep(enum fault_size size, uint32_t seed)
{
    struct fault_reply reply = fault_ask(&bed, size, seed);
    hostile_expect(reply.answer == FAULT_RIGHT && fault_is_kept(&bed, &reply.key, PATIENCE_MS),
                   "mesh %u of size %d is not kept", seed, (int)size);
    return reply.key;
}

static void keep_some(void)
{
    for (uint32_t seed = 0; seed < KEPT; seed++) {
        keep(FAULT_SMALL, seed);
        keep(FAULT_MIDDLE, seed);
    }
}

static void expect_some(const char *when, bool from_disk)
{
    for (uint32_t seed = 0; seed < KEPT; seed++) {
        uint32_t small = fault_expect_right(&bed, FAULT_SMALL, seed, when);
        uint32_t middle = fault_expect_right(&bed, FAULT_MIDDLE, seed, when);
        hostile_expect(!from_disk || (small == ORIGIN_DISK && middle == ORIGIN_DISK), "%s: built again", when);
    }
}

/* ---- no room ---- */

/*
 * Expects that results are kept again soon. The machine may be busy with other things for a while, so one of three is
 * enough.
 */
static void expect_recovery(uint32_t first_seed)
{
    double least = PATIENCE_MS;
    for (uint32_t i = 0; i < 3 && least > SOON_MS; i++) {
        struct fault_reply reply = fault_ask(&bed, FAULT_SMALL, first_seed + i);
        double began = hostile_now();
        hostile_expect(reply.answer == FAULT_RIGHT, "no right answer when there is room again");
        bool kept = fault_is_kept(&bed, &reply.key, PATIENCE_MS);
        double ms = hostile_now() - began;
        least = kept && ms < least ? ms : least;
    }
    hostile_expect(least <= SOON_MS, "results are kept again after %.0f ms", least);
    printf("full disk: results are kept again %.0f ms after there is room\n", least);
}

/* Expects that a call fails soon. Results are written behind the replies, on a machine that may be busy. */
static void expect_failed_call(void)
{
    const double end = hostile_now() + PATIENCE_MS;
    while (bed.plan->failed == 0 && hostile_now() < end)
        fault_pause(1);
    hostile_expect(bed.plan->failed > 0, "no write has failed");
}

static int test_full(void)
{
    begin("0");
    fault_bed_start(&bed);
    keep_some();
    bed.plan->files_only = 1;
    bed.plan->number = ENOSPC;
    fault_bed_arm(&bed,
                  UINT64_C(1) << FAULT_fallocate64 | UINT64_C(1) << FAULT_pwrite64 | UINT64_C(1) << FAULT_write |
                      UINT64_C(1) << FAULT_mkdirat | UINT64_C(1) << FAULT_openat64,
                  0, INT64_MAX);
    for (uint32_t seed = KEPT; seed < SMALL - 3; seed++)
        fault_expect_right(&bed, FAULT_SMALL, seed, "full disk");
    for (uint32_t seed = KEPT; seed < MIDDLE; seed++)
        fault_expect_right(&bed, FAULT_MIDDLE, seed, "full disk");
    expect_some("full disk", true);
    expect_failed_call();
    fault_bed_disarm(&bed);
    expect_recovery(SMALL - 3);
    return end();
}

/* Mounts a file system of 16 MiB at the cache, for this process and its children only. */
static bool mount_small(void)
{
    if (mkdir(bed.cache, 0700) != 0 || unshare(CLONE_NEWNS) != 0)
        return false;
    return mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL) == 0 &&
           mount("tmpfs", bed.cache, "tmpfs", 0, "size=16m,mode=0700") == 0;
}

static void fill_disk(const char *path)
{
    int file = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    off_t size = 0;
    for (off_t step = 1 << 20; step >= 4096; step /= 2)
        while (fallocate(file, 0, size, step) == 0)
            size += step;
    close(file);
}

static int test_small_disk(void)
{
    char filler[128];
    begin("64M");
    if (!mount_small()) {
        printf("small-disk: skipped, because no file system can be mounted: %s\n", strerror(errno));
        fault_bed_remove(&bed);
        return 0;
    }
    fault_bed_start(&bed);
    keep_some();
    snprintf(filler, sizeof filler, "%s/filler", bed.cache);
    fill_disk(filler);
    for (uint32_t seed = KEPT; seed < SMALL - 3; seed++)
        fault_expect_right(&bed, FAULT_SMALL, seed, "full file system");
    for (uint32_t seed = 0; seed < KEPT; seed++)
        hostile_expect(fault_expect_right(&bed, FAULT_MIDDLE, seed, "full file system") == ORIGIN_MEMORY,
                       "a result that was in memory is built again");
    unlink(filler);
    expect_recovery(SMALL - 3);
    bed.hostile.descriptors_base += KEPT; /* of the results in memory */
    int failures = fault_bed_end(&bed);
    umount2(bed.cache, MNT_DETACH);
    fault_bed_remove(&bed);
    return failures;
}

/* ---- no descriptors ---- */

/* Lets the daemon open descriptors below a number. It does not learn of that. 0: as many as it may. */
static void limit_descriptors(rlim_t most)
{
    static struct rlimit before;
    if (before.rlim_max == 0)
        prlimit(bed.hostile.service.pid, RLIMIT_NOFILE, NULL, &before);
    struct rlimit limit = {most ? most : before.rlim_cur, before.rlim_max};
    if (prlimit(bed.hostile.service.pid, RLIMIT_NOFILE, &limit, NULL) != 0)
        perror("prlimit");
}

/* A client from before is answered, and one that comes now is served later. */
static void ask_without_descriptors(rlim_t most, enum fault_size size, const char *when)
{
    struct raw_client early, late;
    bool open = fault_connect(&bed, &early);
    hostile_expect(open, "%s: nobody can connect", when);
    limit_descriptors(most);
    bool waits = raw_connect(&late, bed.hostile.service.socket);
    if (open && fault_send(&early, size, 0)) {
        struct fault_reply reply = fault_receive(&early, size, 0, PATIENCE_MS);
        hostile_expect(reply.answer != FAULT_LOST && reply.answer != FAULT_WRONG, "%s: answer %d", when,
                       (int)reply.answer);
    }
    limit_descriptors(0);
    hostile_expect(waits && fault_say_hello(&late), "%s: who came meanwhile is not served", when);
    raw_close(&late);
    raw_close(&early);
}

static int test_descriptors(void)
{
    begin("0");
    fault_bed_start(&bed);
    uint32_t open = service_process_descriptors(&bed.hostile.service);
    for (uint32_t more = 0; more < 12; more++) {
        char when[64];
        snprintf(when, sizeof when, "%u further descriptors", more);
        fault_clear_cache(&bed);
        ask_without_descriptors(open + more, FAULT_SMALL, when);
        ask_without_descriptors(open + more, FAULT_MIDDLE, when);
        fault_expect_right(&bed, FAULT_MIDDLE, 0, when);
    }
    return end();
}

/* ---- damaged files ---- */

static void find_path(const struct key *key, char ret_path[256])
{
    char name[KEY_TEXT_SIZE];
    key_to_text(key, name);
    snprintf(ret_path, 256, "%s/%.2s/%s", fault_generation(&bed), name, name);
}

static void damage(const char *path)
{
    struct stat about;
    unsigned char byte;
    int file = open(path, O_RDWR | O_CLOEXEC);
    if (file < 0 || fstat(file, &about) != 0) {
        hostile_expect(false, "%s is gone", path);
        return;
    }
    off_t at = (off_t)(random_next(&bed.random) % (uint64_t)about.st_size);
    if (random_next(&bed.random) % 4 == 0) {
        hostile_expect(ftruncate(file, at) == 0, "ftruncate");
    } else {
        bool read = pread(file, &byte, 1, at) == 1;
        byte ^= (unsigned char)(1u << random_next(&bed.random) % 8);
        hostile_expect(read && pwrite(file, &byte, 1, at) == 1, "pwrite");
    }
    close(file);
}

static int test_flips(void)
{
    struct key keys[FAULT_SIZE_COUNT][MIDDLE];
    begin("0");
    fault_bed_start(&bed);
    for (uint32_t seed = 0; seed < MIDDLE; seed++) {
        keys[FAULT_SMALL][seed] = keep(FAULT_SMALL, seed);
        keys[FAULT_MIDDLE][seed] = keep(FAULT_MIDDLE, seed);
    }
    for (uint32_t i = 0; i < options.cycles; i++) {
        char path[256];
        enum fault_size size = random_next(&bed.random) % 2 ? FAULT_SMALL : FAULT_MIDDLE;
        uint32_t seed = (uint32_t)(random_next(&bed.random) % MIDDLE);
        find_path(&keys[size][seed], path);
        damage(path);
        hostile_expect(fault_expect_right(&bed, size, seed, "damage") == ORIGIN_BUILT, "damage %u is not found", i);
        hostile_expect(fault_is_kept(&bed, &keys[size][seed], PATIENCE_MS), "damage %u is not mended", i);
    }
    uint64_t found = hostile_counter(&bed.hostile, "disk_damaged");
    hostile_expect(found == options.cycles, "%llu damaged files of %u are found", (unsigned long long)found,
                   options.cycles);
    printf("flips: %u, all found and built again\n", options.cycles);
    return end();
}

/* ---- time ---- */

static void set_far_time(struct fault_bed *the_bed, const char *path)
{
    (void)the_bed;
    const struct timespec far = {.tv_sec = INT64_C(4102444800)}; /* the year 2100 */
    utimensat(AT_FDCWD, path, (const struct timespec[2]){far, far}, 0);
}

static int test_clock(void)
{
    static const int64_t day = 86400;
    const int64_t offsets[] = {3600, -3600, 3650 * day, -3650 * day, 36500 * day, 0};
    begin("0");
    fault_bed_start(&bed);
    keep_some();
    for (size_t i = 0; i < sizeof offsets / sizeof *offsets; i++) {
        bed.plan->clock_offset_s = offsets[i];
        expect_some("another time of day", true);
        keep(FAULT_SMALL, KEPT + (uint32_t)i);
    }
    fault_each_entry(&bed, set_far_time);
    expect_some("files from the future", true);
    hostile_expect(service_process_end(&bed.hostile.service), "the daemon does not exit cleanly");
    fault_bed_start(&bed);
    expect_some("files from the future, after a start", true);
    return end();
}

/* ---- versions ---- */

static void make_format_newer(struct fault_bed *the_bed, const char *path)
{
    unsigned char byte;
    (void)the_bed;
    int file = open(path, O_RDWR | O_CLOEXEC);
    bool read = pread(file, &byte, 1, 8) == 1;
    byte++;
    hostile_expect(read && pwrite(file, &byte, 1, 8) == 1, "%s cannot be changed", path);
    close(file);
}

static int test_versions(void)
{
    char other[160];
    begin("0");
    fault_bed_start(&bed);
    keep_some();
    uint32_t count = fault_each_entry(&bed, NULL);
    fault_each_entry(&bed, make_format_newer);
    expect_some("a newer format", false);
    keep_some();
    hostile_expect(hostile_counter(&bed.hostile, "disk_damaged") == count, "entries of a newer format were read");
    hostile_expect(service_process_end(&bed.hostile.service), "the daemon does not exit cleanly");
    snprintf(other, sizeof other, "%s/release-999", bed.cache);
    hostile_expect(rename(fault_generation(&bed), other) == 0, "the generation cannot be renamed");
    fault_bed_start(&bed);
    hostile_expect(fault_expect_right(&bed, FAULT_SMALL, 0, "another generation") == ORIGIN_BUILT,
                   "an entry of another generation was read");
    keep_some();
    double end_ms = hostile_now() + PATIENCE_MS;
    while (fault_each_entry(&bed, NULL) < 2 * count && hostile_now() < end_ms)
        fault_pause(5);
    hostile_expect(fault_each_entry(&bed, NULL) == 2 * count, "%u entries of two generations instead of %u",
                   fault_each_entry(&bed, NULL), 2 * count);
    return end();
}

/* ---- clients ---- */

/* Connects, and stops at a random place of what a client says. */
static void stop_somewhere(struct raw_client *client)
{
    unsigned char garbage[FRAME_HEADER_SIZE];
    const struct frame_header header = {.type = FRAME_BUILD, .control_size = 5000, .request = 9};
    frame_header_write(&header, garbage);
    if (!raw_connect(client, bed.hostile.service.socket))
        return;
    uint64_t kind = random_next(&bed.random) % 6;
    if (kind == 0)
        return;
    if (kind > 1)
        fault_say_hello(client);
    if (kind <= 2)
        raw_send(client, garbage, 1 + random_next(&bed.random) % sizeof garbage, NULL, 0);
    else
        fault_send(client, kind % 2 ? FAULT_MIDDLE : FAULT_SMALL, (uint32_t)(random_next(&bed.random) % MIDDLE));
    if (kind >= 4)
        shutdown(client->socket, kind == 4 ? SHUT_RD : SHUT_WR);
}

static int test_half_open(void)
{
    enum { CLIENTS = 64 };
    static struct raw_client clients[CLIENTS];
    begin("0");
    fault_bed_start(&bed);
    keep_some();
    for (int i = 0; i < CLIENTS; i++) {
        stop_somewhere(&clients[i]);
        if (i % 8 == 0)
            expect_some("half-open clients", false);
    }
    for (int i = 0; i < CLIENTS; i++)
        raw_close(&clients[i]);
    expect_some("after half-open clients", true);
    return end();
}

int main(int argc, char **argv)
{
    static const uint32_t meshes[FAULT_SIZE_COUNT] = {SMALL, MIDDLE, 0};
    static const struct {
        const char *name;
        int (*run)(void);
    } tests[] = {{"full", test_full},
                 {"descriptors", test_descriptors},
                 {"flips", test_flips},
                 {"clock", test_clock},
                 {"versions", test_versions},
                 {"half-open", test_half_open},
                 {"small-disk", test_small_disk}};
    int failures = 0;
    options = fault_options_parse(argc, argv, 60);
    setvbuf(stdout, NULL, _IOLBF, 0);
    fault_learn(&options, meshes);
    for (size_t i = 0; i < sizeof tests / sizeof *tests; i++)
        if (fault_options_have(&options, tests[i].name)) {
            double began = hostile_now();
            failures = tests[i].run();
            printf("%-12s %6.0f ms\n", tests[i].name, hostile_now() - began);
        }
    return failures != 0;
}
