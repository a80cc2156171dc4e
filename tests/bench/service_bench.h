/* SPDX-License-Identifier: Apache-2.0 */
/*
 * service_bench.h - what the sections of bench_service share: a clock, quantiles, clients, and calls that end the
 * program when they fail.
 */
#ifndef BVHD_SERVICE_BENCH_H
#define BVHD_SERVICE_BENCH_H

#include <bvhd/bvhd.h>

#include "tests/support/daemon/service_process.h"
#include "tests/support/scene/terrain.h"

struct bench {
    const char *program; /* path of bvhd */
    char **scenes; /* .ply files */
    int scene_count;
    int runs;
    unsigned workers; /* 0: the daemon's default */
    uint32_t entries; /* of the cache on disk */
};

/* One function for each section; they print lines with bench_line. */
void bench_cost(const struct bench *bench);
void bench_hits(const struct bench *bench);
void bench_crowd(const struct bench *bench);
void bench_many(const struct bench *bench);
void bench_small(const struct bench *bench);
void bench_cancels(const struct bench *bench);
void bench_deaths(const struct bench *bench);
void bench_disk(const struct bench *bench);

double bench_now(void); /* milliseconds of a monotonic clock */
__attribute__((noreturn, format(printf, 1, 2))) void bench_fail(const char *format, ...);

/* Prints "WHAT FIGURES (goal: ...)" to stdout and flushes it. */
__attribute__((format(printf, 2, 3))) void bench_line(const char *what, const char *format, ...);

/* Sorts the values and returns the quantile; share 0.5 is the median. */
double bench_quantile(double *values, int count, double share);

/*
 * Starts a daemon with `workers` threads (0: without --workers, unless the command line has it) and --cache-size
 * `cache` ("0", "1G", ...).
 */
void bench_start(const struct bench *bench, unsigned workers, const char *cache, struct service_process *ret_service);
void bench_stop(struct service_process *service);
struct bvhd_client *bench_client(const struct service_process *service);

/* Submits a build and does not wait for it. */
struct bvhd_batch *bench_submit(struct bvhd_client *client, const struct terrain *terrain);

/*
 * Waits for the batch, reads one byte of each page of the results, and destroys the batch. Ends the program unless
 * every item succeeded.
 */
void bench_finish(struct bvhd_batch *batch);

/* Builds once and returns the key of the result; *ret_size is its size in bytes. */
struct bvhd_key bench_key(struct bvhd_client *client, const struct terrain *terrain, uint64_t *ret_size);

/*
 * Builds the meshes in `processes` processes that share nothing, an equal number of meshes each, and returns how many
 * milliseconds that takes.
 */
double bench_apart(const struct terrain *meshes, unsigned count, unsigned processes);

/* The value of one of the service's counters. Ends the program when there is no counter of that name. */
uint64_t bench_counter(struct bvhd_client *client, const char *name);

#endif
