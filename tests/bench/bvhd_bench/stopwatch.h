/* SPDX-License-Identifier: Apache-2.0 */
/*
 * stopwatch.h - tells the time that builds are measured by: wall-clock time for several threads, the process's
 * processor time for one. Processor time is hardly disturbed by other programs, and equals wall-clock time as long as
 * nothing waits.
 */
#ifndef BVHD_BENCH_STOPWATCH_H
#define BVHD_BENCH_STOPWATCH_H

#include <time.h>

/* Milliseconds of a clock, since some fixed moment. */
static inline double stopwatch_of(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

static inline double stopwatch_wall_ms(void)
{
    return stopwatch_of(CLOCK_MONOTONIC);
}

static inline double stopwatch_cpu_ms(void)
{
    return stopwatch_of(CLOCK_PROCESS_CPUTIME_ID);
}

static inline double stopwatch_ms(unsigned threads)
{
    return threads == 1 ? stopwatch_cpu_ms() : stopwatch_wall_ms();
}

#endif
