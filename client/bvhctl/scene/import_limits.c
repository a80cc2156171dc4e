/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_limits.h"

#include <stdio.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <unistd.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define HAS_SHADOW_MEMORY 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define HAS_SHADOW_MEMORY 1
#endif
#ifndef HAS_SHADOW_MEMORY
#define HAS_SHADOW_MEMORY 0
#endif

/*
 * Without a file: assimp's start takes a tenth of the time. For each byte: the slowest importers of text take a tenth
 * of the time, which leaves room for formats that are compressed. The first bytes of a file are worth more, because a
 * few of them can describe curves and subdivisions: a file of 2,770 bytes that is worth reading takes 0.26 s.
 */
enum {
    TIME_BASE_US = HAS_SHADOW_MEMORY ? 2000000 : 150000,
    TIME_A_BYTE_US = HAS_SHADOW_MEMORY ? 200 : 10,
    TIME_A_FIRST_BYTE_US = 90, /* in addition */
    FIRST_BYTES = 4096,
    TIME_MAX_S = 100000,
    MEMORY_A_BYTE = 256,
};

static const uint64_t memory_base = UINT64_C(512) << 20;

static unsigned factor_of_process; /* 0: this process is not limited */
static uint64_t bytes_allowed; /* beyond what it had when the limits were set */

/* Returns the address space in use. Stacks of threads and heaps take much of it before anything is read. */
static rlim_t used_memory(void)
{
    unsigned long long pages = 0;
    FILE *file = fopen("/proc/self/statm", "re");
    if (file && fscanf(file, "%llu", &pages) != 1)
        pages = 0;
    if (file)
        fclose(file);
    return (rlim_t)pages * (rlim_t)sysconf(_SC_PAGESIZE);
}

static void limit_memory(void)
{
    struct rlimit limit;
    rlim_t wanted = used_memory() + memory_base * factor_of_process;
    if (!HAS_SHADOW_MEMORY && getrlimit(RLIMIT_AS, &limit) == 0 && wanted < limit.rlim_cur) {
        limit.rlim_cur = wanted;
        if (setrlimit(RLIMIT_AS, &limit) == 0)
            bytes_allowed = memory_base * factor_of_process;
    }
}

static void allow_memory(uint64_t size)
{
    struct rlimit limit;
    if (getrlimit(RLIMIT_AS, &limit) < 0 || limit.rlim_cur >= limit.rlim_max)
        return;
    rlim_t left = limit.rlim_max - limit.rlim_cur, each = (rlim_t)MEMORY_A_BYTE * factor_of_process;
    rlim_t more = size < left / each ? size * each : left;
    limit.rlim_cur += more;
    bytes_allowed += more;
    setrlimit(RLIMIT_AS, &limit);
}

/* Adds processor time, in microseconds, to what this process has left. */
static void allow_time(uint64_t microseconds)
{
    struct itimerval timer;
    if (getitimer(ITIMER_PROF, &timer) < 0)
        return;
    uint64_t left = (uint64_t)timer.it_value.tv_sec * 1000000 + (uint64_t)timer.it_value.tv_usec;
    left += microseconds < UINT64_C(1000000) * TIME_MAX_S ? microseconds : UINT64_C(1000000) * TIME_MAX_S;
    timer = (struct itimerval){.it_value = {(time_t)(left / 1000000), (suseconds_t)(left % 1000000)}};
    setitimer(ITIMER_PROF, &timer, NULL);
}

void import_limits_set(unsigned factor)
{
    factor_of_process = factor;
    setrlimit(RLIMIT_CORE, &(struct rlimit){0, 0});
    limit_memory();
    allow_time((uint64_t)TIME_BASE_US * factor);
}

void import_limits_allow(uint64_t size)
{
    if (!factor_of_process)
        return;
    uint64_t most = UINT64_C(1000000) * TIME_MAX_S / TIME_A_BYTE_US;
    allow_memory(size);
    uint64_t first = size < FIRST_BYTES ? size : FIRST_BYTES;
    allow_time(first * TIME_A_FIRST_BYTE_US * factor_of_process);
    allow_time((size < most ? size : most) * TIME_A_BYTE_US * factor_of_process);
}

uint64_t import_limits_memory(void)
{
    return bytes_allowed;
}
