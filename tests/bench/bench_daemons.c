/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_daemons - compares what daemons of different versions need for the same builds.
 *
 *     bench_daemons [--rounds N] BVHD BVHD... [-- OPTION...]
 *
 * The daemons run beside each other, with the same options (default: --cache-size 0), and are given each load in turn:
 * in each round, each daemon once. For each daemon it prints the medians over all rounds, and the medians of the ratios
 * to the first daemon in the same round: of the time from submission to the last result, and of the processor time of
 * the daemon. The loads:
 *   small   640 meshes of 2,000 triangles in one batch
 *   large   one mesh of 800,000 triangles
 *   both    these at the same time, from two clients
 * Meshes change from round to round, so that no daemon has a result already.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tests/bench/service_bench.h"

enum { MESHES = 640, SMALL = 2000, LARGE = 800000, MOST_DAEMONS = 8, MOST_ROUNDS = 1000 };

static struct terrain meshes[MESHES], large;
static VkAccelerationStructureBuildGeometryInfoKHR infos[MESHES];
static const VkAccelerationStructureBuildRangeInfoKHR *ranges[MESHES];

/* One daemon with its clients, and what each round took it, in milliseconds. */
struct contender {
    const char *program;
    struct service_process process;
    struct bvhd_client *clients[2];
    clockid_t clock; /* its processor time */
    double wall[MOST_ROUNDS], processor[MOST_ROUNDS];
};

static struct contender contenders[MOST_DAEMONS];
static int contender_count, rounds = 15;

static struct bvhd_batch *submit_small(struct bvhd_client *client)
{
    struct bvhd_build build = {.struct_size = sizeof build, .info_count = MESHES, .infos = infos, .ranges = ranges};
    struct bvhd_error error;
    struct bvhd_batch *batch;
    if (bvhd_batch_submit(client, &build, &batch, &error) != BVHD_OK)
        bench_fail("%s: %s", error.where, error.text);
    return batch;
}

static double processor_ms(const struct contender *contender)
{
    struct timespec time;
    if (clock_gettime(contender->clock, &time) != 0)
        bench_fail("%s: its processor time cannot be read", contender->program);
    return (double)time.tv_sec * 1e3 + (double)time.tv_nsec * 1e-6;
}

static void run_load(struct contender *contender, int round, bool is_small, bool is_large)
{
    double begin = bench_now(), processor = processor_ms(contender);
    struct bvhd_batch *big = is_large ? bench_submit(contender->clients[0], &large) : NULL;
    struct bvhd_batch *many = is_small ? submit_small(contender->clients[1]) : NULL;
    if (many)
        bench_finish(many);
    if (big)
        bench_finish(big);
    contender->wall[round] = bench_now() - begin;
    contender->processor[round] = processor_ms(contender) - processor;
}

/* Returns the median of the values, or of their ratios to others. */
static double median(const double *values, const double *others)
{
    double ratios[MOST_ROUNDS];
    for (int i = 0; i < rounds; i++)
        ratios[i] = others ? values[i] / others[i] : values[i];
    return bench_quantile(ratios, rounds, 0.5);
}

static void compare(const char *load, bool is_small, bool is_large)
{
    for (int round = -1; round < rounds; round++) { /* the first one only warms up */
        for (int i = 0; i < MESHES; i++)
            meshes[i].positions[2] += 1;
        large.positions[2] += 1;
        for (int i = 0; i < contender_count; i++)
            run_load(&contenders[(i + round + 1) % contender_count], round < 0 ? 0 : round, is_small, is_large);
    }
    for (int i = 0; i < contender_count; i++) {
        const struct contender *one = &contenders[i], *first = &contenders[0];
        printf("%-6s %-40s %8.1f ms, %.3f; processor time %8.1f ms, %.3f\n", load, one->program,
               median(one->wall, NULL), median(one->wall, first->wall), median(one->processor, NULL),
               median(one->processor, first->processor));
        fflush(stdout);
    }
}

static void start(struct contender *contender, const char *program, const char *const *options)
{
    contender->program = program;
    service_process_start(&contender->process, program, options);
    for (int i = 0; i < 2; i++)
        contender->clients[i] = bench_client(&contender->process);
    if (clock_getcpuclockid(contender->process.pid, &contender->clock) != 0)
        bench_fail("%s: it has no clock", program);
}

static void stop(struct contender *contender)
{
    for (int i = 0; i < 2; i++)
        bvhd_client_destroy(contender->clients[i]);
    bench_stop(&contender->process);
}

static int usage(void)
{
    fputs("usage: bench_daemons [--rounds N] BVHD BVHD... [-- OPTION...]\n", stderr);
    return 2;
}

int main(int argc, char **argv)
{
    static const char *const none[] = {"--cache-size", "0", NULL};
    const char *const *options = none;
    int at = 1;
    if (argc > 2 && !strcmp(argv[1], "--rounds")) {
        rounds = atoi(argv[2]);
        at = 3;
    }
    int first = at;
    while (at < argc && argv[at][0] != '-')
        at++;
    contender_count = at - first;
    if (at + 1 < argc && !strcmp(argv[at], "--"))
        options = (const char *const *)argv + at + 1;
    else if (at < argc)
        return usage();
    if (contender_count < 1 || contender_count > MOST_DAEMONS || rounds < 1 || rounds > MOST_ROUNDS)
        return usage();
    for (int i = 0; i < MESHES; i++) {
        terrain_init(&meshes[i], SMALL, (uint32_t)i + 100);
        infos[i] = meshes[i].info;
        ranges[i] = meshes[i].ranges;
    }
    terrain_init(&large, LARGE, 1);
    for (int i = 0; i < contender_count; i++)
        start(&contenders[i], argv[first + i], options);
    compare("small", true, false);
    compare("large", false, true);
    compare("both", true, true);
    for (int i = 0; i < contender_count; i++)
        stop(&contenders[i]);
    for (int i = 0; i < MESHES; i++)
        terrain_finish(&meshes[i]);
    terrain_finish(&large);
    return 0;
}
