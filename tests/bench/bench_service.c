/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_service - measures what the service costs, and how it divides its workers between clients.
 *
 *     bench_service BVHD [--runs N] [--workers N] [--entries N] [SECTION...] [SCENE.ply...]
 *
 * It starts its own daemons; BVHD is the path of the program. The sections, all of which run when none is named:
 *   cost    a build through the service, interleaved with one of the same views, canonical copy and blob in this
 *           process, without key and socket
 *   hits    fetching a result of 1 KiB and of 1 MiB by key; building the geometry of a 1 MiB result again
 *   crowd   fetching by 1 to 8 clients at once, in processes of their own: hits a second, and how busy the daemon's
 *           busiest thread is
 *   many    640 different meshes of 2,000 triangles in one batch: all workers compared with one; and the same in
 *           processes that share nothing, which shows what the machine can give
 *   small   a small job beside a build of 4 million triangles, and on a quiet daemon
 *   cancel  200 cancels of queued builds, and 200 of running ones
 *   death   how long the work and the resources of a client last after it died
 *   disk    results on disk: from the start of a daemon to its first hit among 200,000 entries (or N), hits of 1 KiB
 *           and of 1 MiB without a pause and 2 ms apart, and what a miss costs beside a daemon without them
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/bench/service_bench.h"

static const struct section {
    const char *name;
    void (*run)(const struct bench *bench);
} sections[] = {
    {"cost", bench_cost},   {"hits", bench_hits},      {"crowd", bench_crowd},  {"many", bench_many},
    {"small", bench_small}, {"cancel", bench_cancels}, {"death", bench_deaths}, {"disk", bench_disk},
};

enum { SECTIONS = sizeof sections / sizeof *sections };

static int find_section(const char *name)
{
    for (int i = 0; i < SECTIONS; i++)
        if (!strcmp(sections[i].name, name))
            return i;
    return -1;
}

int main(int argc, char **argv)
{
    if (argc < 2 || argv[1][0] == '-') {
        fputs("usage: bench_service BVHD [--runs N] [--workers N] [--entries N] "
              "[cost|hits|crowd|many|small|cancel|death|disk ...] "
              "[SCENE.ply ...]\n",
              stderr);
        return 2;
    }
    struct bench bench = {.program = argv[1], .runs = 15, .entries = 200000};
    bool chosen[SECTIONS] = {false}, any = false;
    int at = 2;
    for (; at < argc; at++) {
        int section = find_section(argv[at]);
        if (section >= 0)
            chosen[section] = any = true;
        else if (!strcmp(argv[at], "--runs") && at + 1 < argc)
            bench.runs = atoi(argv[++at]);
        else if (!strcmp(argv[at], "--workers") && at + 1 < argc)
            bench.workers = (unsigned)atoi(argv[++at]);
        else if (!strcmp(argv[at], "--entries") && at + 1 < argc)
            bench.entries = (uint32_t)atoi(argv[++at]);
        else
            break;
    }
    bench.scenes = argv + at;
    bench.scene_count = argc - at;
    bench.runs = bench.runs < 1 ? 1 : bench.runs;
    for (int i = 0; i < SECTIONS; i++)
        if (!any || chosen[i])
            sections[i].run(&bench);
    return 0;
}
