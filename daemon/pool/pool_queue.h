/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pool_queue.h - the jobs of one flow that wait: the highest priority first, of equal ones the oldest.
 *
 * Sizes fall into classes, powers of two, each with a pairing heap of its own, so that the first of the small jobs is
 * found behind large ones. Whatever it costs to keep the order is linked into the jobs: nothing is allocated, nothing
 * can fail. Zeroed is empty.
 */
#ifndef BVHD_POOL_QUEUE_H
#define BVHD_POOL_QUEUE_H

#include "daemon/pool/pool.h"

enum { POOL_QUEUE_CLASSES = 64 };

struct pool_queue {
    uint64_t filled; /* bit i: class i, sizes of [2^i, 2^(i+1)), has jobs */
    struct pool_job *first[POOL_QUEUE_CLASSES];
};

/* True when `job` goes before `other`. Different jobs have different orders. */
static inline bool pool_queue_before(const struct pool_job *job, const struct pool_job *other)
{
    return job->priority != other->priority ? job->priority > other->priority : job->order < other->order;
}

/* Size 0 counts as 1. */
static inline uint64_t pool_queue_size(const struct pool_job *job)
{
    return job->size ? job->size : 1;
}

/* Which class a size falls into. */
static inline unsigned pool_queue_class(uint64_t size)
{
    return 63 - (unsigned)__builtin_clzll(size | 1);
}

/* O(1); priority, size and order must not change while the job is in. */
void pool_queue_put(struct pool_queue *queue, struct pool_job *job);

/* Any job that is in; O(log n) amortised. */
void pool_queue_remove(struct pool_queue *queue, struct pool_job *job);

/* NULL when empty. */
struct pool_job *pool_queue_first(const struct pool_queue *queue);

/* The first among the jobs of size <= `most`; jobs of the class of `most` itself may be overlooked. */
struct pool_job *pool_queue_first_small(const struct pool_queue *queue, uint64_t most);

#endif
