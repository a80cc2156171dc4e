/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/descriptors.h"

#include <assert.h>
#include <dirent.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/resource.h>

/* How many descriptors are probed where the system does not list the open ones: more than any parent hands down. */
enum { PROBED = 4096 };

/*
 * Descriptors that are still open after their count was given back. Global, because descriptors belong to the process.
 */
static _Atomic uint32_t lingering;

static uint64_t raise_limit(void)
{
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0)
        return 0;
    struct rlimit raised = {.rlim_cur = limit.rlim_max, .rlim_max = limit.rlim_max};
    return setrlimit(RLIMIT_NOFILE, &raised) == 0 ? raised.rlim_cur : limit.rlim_cur;
}

static uint32_t probe_open(uint64_t limit)
{
    uint32_t count = 0;
    for (int descriptor = 0; descriptor < PROBED && (uint64_t)descriptor < limit; descriptor++)
        count += fcntl(descriptor, F_GETFD) >= 0;
    return count;
}

/*
 * Counts the open descriptors below the limit. A descriptor above it, which a parent with a higher limit opened, does
 * not reduce how many can still be opened.
 */
static uint32_t count_open(uint64_t limit)
{
    DIR *directory = opendir("/proc/self/fd");
    if (!directory)
        return probe_open(limit);
    uint32_t count = 0;
    for (struct dirent *entry; (entry = readdir(directory));)
        count += entry->d_name[0] != '.' && strtoull(entry->d_name, NULL, 10) < limit;
    closedir(directory);
    return count ? count - 1 : 0; /* the directory's own descriptor was listed, too */
}

void descriptors_init(struct descriptors *descriptors)
{
    uint64_t limit = raise_limit();
    uint32_t open = count_open(limit), cap = limit < UINT32_MAX ? (uint32_t)limit : UINT32_MAX;
    descriptors->limit = cap > open ? cap - open : 0;
    atomic_init(&descriptors->used, 0);
    atomic_init(&descriptors->unread, 0);
}

/* Adds `count` if the sum stays within `limit`; otherwise returns false and adds nothing. */
static bool add_within(_Atomic uint32_t *counter, uint32_t count, uint64_t limit)
{
    uint32_t before = atomic_load_explicit(counter, memory_order_relaxed);
    do {
        if ((uint64_t)before + count > limit)
            return false;
    } while (!atomic_compare_exchange_weak_explicit(counter, &before, before + count, memory_order_relaxed,
                                                    memory_order_relaxed));
    return true;
}

static void subtract(_Atomic uint32_t *counter, uint32_t count)
{
    uint32_t before = atomic_fetch_sub_explicit(counter, count, memory_order_relaxed);
    assert(before >= count);
    (void)before;
}

bool descriptors_take(struct descriptors *descriptors, uint32_t count, uint32_t keep)
{
    uint64_t kept = (uint64_t)keep + atomic_load_explicit(&lingering, memory_order_relaxed);
    return kept <= descriptors->limit && add_within(&descriptors->used, count, descriptors->limit - kept);
}

void descriptors_give(struct descriptors *descriptors, uint32_t count)
{
    subtract(&descriptors->used, count);
}

uint32_t descriptors_left(const struct descriptors *descriptors)
{
    uint64_t taken = (uint64_t)atomic_load_explicit(&descriptors->used, memory_order_relaxed) +
                     atomic_load_explicit(&lingering, memory_order_relaxed);
    return taken < descriptors->limit ? descriptors->limit - (uint32_t)taken : 0;
}

void descriptors_linger(void)
{
    atomic_fetch_add_explicit(&lingering, 1, memory_order_relaxed);
}

void descriptors_lingered(void)
{
    subtract(&lingering, 1);
}

uint32_t descriptors_sendable(const struct descriptors *descriptors)
{
    uint32_t most = descriptors->limit / 2, unread = atomic_load_explicit(&descriptors->unread, memory_order_relaxed);
    return unread < most ? most - unread : 0;
}

bool descriptors_send(struct descriptors *descriptors, uint32_t count)
{
    return add_within(&descriptors->unread, count, descriptors->limit / 2);
}

void descriptors_read(struct descriptors *descriptors, uint32_t count)
{
    subtract(&descriptors->unread, count);
}
