/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/timed_parallel.h"

#include "proto/base/clock.h"

struct timed_work {
    const struct timed_parallel *timed;
    parallel_task task;
    void *context;
};

static void run_timed(void *context, size_t index)
{
    const struct timed_work *work = context;
    const struct timed_parallel *timed = work->timed;
    uint64_t moment = atomic_load_explicit(timed->moment, memory_order_relaxed);
    if (moment != TIMED_PARALLEL_NEVER && clock_ns() >= moment)
        atomic_store_explicit(timed->cancel, true, memory_order_relaxed);
    work->task(work->context, index);
}

static void timed_for_each(const struct parallel *self, size_t count, parallel_task task, void *context)
{
    const struct timed_parallel *timed = (const struct timed_parallel *)self;
    struct timed_work work = {timed, task, context};
    parallel_for(timed->inner, count, run_timed, &work);
}

void timed_parallel_init(struct timed_parallel *timed, const struct parallel *inner, const _Atomic uint64_t *moment,
                         atomic_bool *cancel)
{
    *timed = (struct timed_parallel){
        .parallel = {inner->threads, timed_for_each}, .inner = inner, .moment = moment, .cancel = cancel};
}
