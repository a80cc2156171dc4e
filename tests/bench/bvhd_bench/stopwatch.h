/* SPDX-License-Identifier: Apache-2.0 */
/*
 * stopwatch.h - what a build takes: of several threads the time on the wall, of one the processor's, which others on
 * the machine hardly disturb and which is the same as long as nothing waits.
 */
#ifndef BVHD_BENCH_STOPWATCH_H
#define BVHD_BENCH_STOPWATCH_H

#include <time.h>

/* Milliseconds since some moment. */
static inline double stopwatch_ms(unsigned threads)
{
    struct timespec now;
    clock_gettime(threads == 1 ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

#endif
