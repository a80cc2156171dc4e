/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/heap.h"

#include <stdatomic.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "daemon/system/detached.h"
#include "proto/base/memory.h"

void heap_limit(uint64_t budget, unsigned threads)
{
    memory_keep_heap(budget / HEAP_DIVISOR / (threads ? threads : 1));
}

static atomic_bool is_trimming;

static void *trim(void *unused)
{
    (void)unused;
#ifdef __GLIBC__
    malloc_trim(0);
#endif
    atomic_store(&is_trimming, false);
    return NULL;
}

void heap_trim(void)
{
    if (!atomic_exchange(&is_trimming, true) && !detached_start(trim, NULL))
        atomic_store(&is_trimming, false);
}
