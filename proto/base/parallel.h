/* SPDX-License-Identifier: Apache-2.0 */
/*
 * parallel.h - the interface through which code that owns no threads runs tasks on several.
 *
 * for_each calls task(context, i) once for every i in [0, count), in any order, on any threads including the caller's,
 * and returns when all calls have returned. Results must not depend on the order or on the number of threads. Tasks may
 * call for_each again.
 */
#ifndef BVHD_PARALLEL_H
#define BVHD_PARALLEL_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>

typedef void (*parallel_task)(void *context, size_t index);

/* A way to run tasks, which pools of threads implement. */
struct parallel {
    unsigned threads; /* how many tasks can run at once; at least 1 */
    void (*for_each)(const struct parallel *self, size_t count, parallel_task task, void *context);
};

/* Runs every task on the calling thread, in order. */
extern const struct parallel parallel_serial;

static inline void parallel_for(const struct parallel *parallel, size_t count, parallel_task task, void *context)
{
    parallel->for_each(parallel, count, task, context);
}

/* Returns whether the result is not needed any more. `cancel` may be NULL; once set it stays set. */
static inline bool parallel_cancelled(const atomic_bool *cancel)
{
    return cancel && atomic_load_explicit(cancel, memory_order_relaxed);
}

/* Checks the same in step number `step` of many short ones, once every few thousand steps. */
static inline bool parallel_cancelled_at(const atomic_bool *cancel, size_t step)
{
    return step % 8192 == 0 && parallel_cancelled(cancel);
}

/*
 * Works like parallel_for, but skips the tasks that have not begun when *cancel is set. Returns false if it is set, so
 * that tasks may be missing.
 */
bool parallel_for_until(const struct parallel *parallel, const atomic_bool *cancel, size_t count, parallel_task task,
                        void *context);

/* Returns how many chunks of `chunk` things `total` things are cut into; only the last one may be smaller. */
static inline size_t parallel_chunks(size_t chunk, size_t total)
{
    return total / chunk + (total % chunk != 0);
}

/*
 * Computes the half-open range [*ret_begin, *ret_end) of chunk `index` when `total` things are cut into chunks of
 * `chunk`.
 */
static inline void parallel_chunk(size_t index, size_t chunk, size_t total, size_t *ret_begin, size_t *ret_end)
{
    *ret_begin = index * chunk;
    *ret_end = total - *ret_begin < chunk ? total : *ret_begin + chunk;
}

#endif
