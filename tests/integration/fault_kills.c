/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fault_kills.c - ends a daemon with SIGKILL while clients use it, again and again, and starts it on the cache that it
 * leaves behind. No reply may have wrong bytes, the daemon starts each time, and nobody cleans anything up.
 *
 *     fault_kills BVHD SHIM [--cycles N] [--seed N]
 */
#include <glob.h>
#include <stdio.h>
#include <string.h>

#include "tests/support/daemon/fault_bed.h"

/* The results are twice as many as fit on disk, so that daemons write and remove entries all the time. */
enum { CLIENTS = 4, SMALL = 24, MIDDLE = 24, LARGE = 1, MOST_MS = 60, SOON_MS = 2 };

static struct fault_bed bed;
static uint64_t replies, hits, hits_of_disk;

/* A client with one request under way. */
struct load {
    struct raw_client client;
    enum fault_size size;
    uint32_t seed;
    bool open;
};

static void choose(struct load *load)
{
    static const uint32_t meshes[FAULT_SIZE_COUNT] = {SMALL, MIDDLE, LARGE};
    uint64_t number = random_next(&bed.random);
    load->size = number % 64 == 0 ? FAULT_LARGE : number % 2 == 0 ? FAULT_MIDDLE : FAULT_SMALL;
    load->seed = (uint32_t)((number >> 8) % meshes[load->size]);
}

static void send_next(struct load *load)
{
    choose(load);
    load->open = fault_send(&load->client, load->size, load->seed);
}

static void take_reply(struct load *load)
{
    struct fault_reply reply = fault_receive(&load->client, load->size, load->seed, SOON_MS);
    hostile_expect(reply.answer != FAULT_WRONG, "mesh %u of size %d has other bytes", load->seed, (int)load->size);
    hostile_expect(reply.answer != FAULT_REFUSED, "mesh %u of size %d: %s", load->seed, (int)load->size,
                   reply.error.text);
    if (reply.answer == FAULT_CLOSED)
        load->open = false;
    if (reply.answer != FAULT_RIGHT)
        return;
    replies++;
    hits += reply.origin == ORIGIN_MEMORY || reply.origin == ORIGIN_DISK;
    hits_of_disk += reply.origin == ORIGIN_DISK;
    send_next(load);
}

/* Uses the daemon for a random time, kills it, and reads what it has answered by then. */
static void cycle(void)
{
    struct load loads[CLIENTS];
    double end = hostile_now() + random_between(&bed.random, 0, MOST_MS);
    for (int i = 0; i < CLIENTS; i++) {
        loads[i].open = fault_connect(&bed, &loads[i].client);
        hostile_expect(loads[i].open, "the daemon accepts nobody");
        if (loads[i].open)
            send_next(&loads[i]);
    }
    while (hostile_now() < end)
        for (int i = 0; i < CLIENTS; i++)
            if (loads[i].open)
                take_reply(&loads[i]);
    service_process_kill(&bed.hostile.service);
    for (int i = 0; i < CLIENTS; i++) {
        while (loads[i].open)
            take_reply(&loads[i]);
        raw_close(&loads[i].client);
    }
}

static size_t count_files(const char *pattern)
{
    char path[128];
    glob_t found;
    snprintf(path, sizeof path, "%s/%s", bed.cache, pattern);
    glob(path, GLOB_NOSORT, NULL, &found);
    size_t count = found.gl_pathc;
    globfree(&found);
    return count;
}

static size_t unfinished_files(void)
{
    return count_files("*/[0-9a-f][0-9a-f]/.[!.]*");
}

/* After a start like any other everything is there, and what killed daemons have begun is gone. */
static void look_at_the_rest(void)
{
    double end = hostile_now() + 10000;
    for (uint32_t seed = 0; seed < SMALL; seed++)
        fault_expect_right(&bed, FAULT_SMALL, seed, "after the last kill");
    for (uint32_t seed = 0; seed < MIDDLE; seed++)
        fault_expect_right(&bed, FAULT_MIDDLE, seed, "after the last kill");
    for (uint32_t seed = 0; seed < LARGE; seed++)
        fault_expect_right(&bed, FAULT_LARGE, seed, "after the last kill");
    size_t left; /* the daemon that runs has unfinished files of its own now and then */
    while ((left = unfinished_files()) > 0 && hostile_now() < end)
        fault_pause(10);
    hostile_expect(left == 0, "%zu unfinished files are left", left);
}

int main(int argc, char **argv)
{
    static const uint32_t meshes[FAULT_SIZE_COUNT] = {SMALL, MIDDLE, LARGE};
    static const char *const more[] = {"--disk-cache-size", "2M", "--log-level", "warning", NULL};
    struct fault_options options = fault_options_parse(argc, argv, 20);
    fault_learn(&options, meshes);
    fault_bed_init(&bed, &options, "0", more);
    /* On a slow machine it takes more cycles until a daemon lives long enough to write and to read. */
    for (uint32_t i = 0; i < options.cycles || (hits_of_disk == 0 && i < 10 * options.cycles); i++) {
        fault_bed_start(&bed);
        cycle();
    }
    fault_bed_start(&bed);
    look_at_the_rest();
    hostile_expect(count_files("*/damaged/*") == 0, "%zu entries were damaged", count_files("*/damaged/*"));
    hostile_expect(hits_of_disk > 0, "the cache on disk was not used");
    int failures = fault_bed_end(&bed);
    fault_bed_remove(&bed);
    printf("%u kills: %llu right replies, %llu of them kept ones, %llu from disk; %d failures\n", options.cycles,
           (unsigned long long)replies, (unsigned long long)hits, (unsigned long long)hits_of_disk, failures);
    return failures != 0;
}
