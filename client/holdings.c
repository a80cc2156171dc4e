/* SPDX-License-Identifier: Apache-2.0 */
#include "client/holdings.h"

#include <stdatomic.h>

#include "client/library.h"

struct holdings {
    atomic_uint refs;
    uint64_t most; /* constant */
    _Atomic uint64_t held; /* bytes of results that came and are not released */
    _Atomic uint64_t released; /* bytes that the daemon has not been told of */
};

struct holdings *holdings_create(uint64_t most)
{
    struct holdings *holdings = memory_alloc(&library_memory, sizeof *holdings);
    if (!holdings)
        return NULL;
    *holdings = (struct holdings){.most = most};
    atomic_init(&holdings->refs, 1);
    return holdings;
}

struct holdings *holdings_ref(struct holdings *holdings)
{
    if (holdings)
        atomic_fetch_add_explicit(&holdings->refs, 1, memory_order_relaxed);
    return holdings;
}

void holdings_unref(struct holdings *holdings)
{
    if (holdings && atomic_fetch_sub_explicit(&holdings->refs, 1, memory_order_acq_rel) == 1)
        memory_free(&library_memory, holdings);
}

bool holdings_add(struct holdings *holdings, uint64_t size)
{
    return atomic_fetch_add_explicit(&holdings->held, size, memory_order_relaxed) + size <= holdings->most;
}

void holdings_release(struct holdings *holdings, uint64_t size)
{
    atomic_fetch_sub_explicit(&holdings->held, size, memory_order_relaxed);
    atomic_fetch_add_explicit(&holdings->released, size, memory_order_relaxed);
}

uint64_t holdings_collect(struct holdings *holdings)
{
    return atomic_exchange_explicit(&holdings->released, 0, memory_order_relaxed);
}
