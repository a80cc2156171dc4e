/* SPDX-License-Identifier: Apache-2.0 */
/*
 * service_bench.h - what the parts of bench_service share: clock, medians, clients, one-line calls that end the program
 * when they fail.
 */
#ifndef BVHD_SERVICE_BENCH_H
#define BVHD_SERVICE_BENCH_H

#include <bvhd/bvhd.h>

#include "tests/support/daemon/service_process.h"
#include "tests/support/scene/terrain.h"

struct bench {
    const char *program; /* bvhd */
    char **scenes; /* .ply files */
    int scene_count;
    int runs;
    unsigned workers; /* 0: as many as the daemon likes */
};

/* One a section; they print lines by bench_line. */
void bench_cost(const struct bench *bench);
void bench_hits(const struct bench *bench);
void bench_many(const struct bench *bench);
void bench_small(const struct bench *bench);
void bench_cancels(const struct bench *bench);
void bench_deaths(const struct bench *bench);

double bench_now(void); /* milliseconds */
__attribute__((noreturn, format(printf, 1, 2))) void bench_fail(const char *format, ...);

/* "WHAT: figure unit (goal: ...)": on stdout, flushed. */
__attribute__((format(printf, 2, 3))) void bench_line(const char *what, const char *format, ...);

/* Sorts the values; share 0.5 is the median. */
double bench_quantile(double *values, int count, double share);

/* A daemon with `workers` (0: not said), `cache` ("0", "1G", ...). */
void bench_start(const struct bench *bench, unsigned workers, const char *cache, struct service_process *ret_service);
void bench_stop(struct service_process *service);
struct bvhd_client *bench_client(const struct service_process *service);

/* Without waiting. */
struct bvhd_batch *bench_submit(struct bvhd_client *client, const struct terrain *terrain);

/* Waits; ends the program unless every item is well. Reads one byte of each page. */
void bench_finish(struct bvhd_batch *batch);

/*
 * Milliseconds that the builds of these meshes take in as many processes that share nothing, an equal number of meshes
 * each.
 */
double bench_apart(const struct terrain *meshes, unsigned count, unsigned processes);

/* The value of one of the service's counters; ends the program when there is none of that name. */
uint64_t bench_counter(struct bvhd_client *client, const char *name);

#endif
