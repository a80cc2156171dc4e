/* SPDX-License-Identifier: Apache-2.0 */
/*
 * latency.h - how long items take: distributions of times in bounded memory, however many times there are.
 *
 * A daemon that runs for months has to say how it does now, so percentiles are those of the last LATENCY_PERIOD_NS to
 * twice that: times are counted in two windows, and a new period clears the older one. Monitoring, which makes its own
 * windows, gets the sums since the start in powers of two.
 *
 * A window counts microseconds in buckets of LATENCY_STEPS a power of two, so that a percentile is at most one eighth
 * too high. For the loop thread only. Zeroed means empty.
 */
#ifndef BVHD_LATENCY_H
#define BVHD_LATENCY_H

#include <stdint.h>

/*
 * The stages of an item. waiting: for memory, for threads and for builds of other items. prepare: of items that were
 * prepared. disk, build: of lookups on disk and of builds, each of which counts once. total: from the arrival of the
 * request to the result.
 */
#define LATENCY_STAGES(X) X(waiting) X(prepare) X(disk) X(build) X(total)

enum latency_stage {
#define STAGE(name) LATENCY_##name,
    LATENCY_STAGES(STAGE)
#undef STAGE
        LATENCY_STAGE_COUNT
};

#define LATENCY_PERIOD_NS UINT64_C(300000000000)

enum {
    LATENCY_STEPS = 8,
    LATENCY_POWERS = 36, /* up to 2^36 us, 19 hours; longer times count as that */
    LATENCY_BUCKETS = (LATENCY_POWERS - 2) * LATENCY_STEPS
};

struct latency_window {
    uint64_t period; /* the number of the period since the clock's start */
    uint64_t count, most_us;
    uint32_t buckets[LATENCY_BUCKETS];
};

/* The times of one stage. */
struct latency {
    uint64_t count, sum_us; /* since the start */
    uint64_t powers[LATENCY_POWERS]; /* [i] counts times of at least 2^i us (0: of any) and less than 2^(i + 1) us */
    struct latency_window windows[2];
};

/* Adds a time. `now_ns` is CLOCK_MONOTONIC. */
void latency_add(struct latency *latency, uint64_t now_ns, uint64_t ns);

/* The recent times. The percentiles are in microseconds, and 0 without times. */
struct latency_summary {
    uint64_t count, p50_us, p90_us, p99_us, most_us;
};

struct latency_summary latency_summary(const struct latency *latency, uint64_t now_ns);

#endif
