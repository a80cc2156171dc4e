/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pool_queue.h - the queued jobs of one flow, ordered by priority (the highest first), then by age (the oldest first).
 *
 * Jobs are divided into classes by their size, a power of two each, and each class has its own pairing heap. So the
 * first of the small jobs is found even when large jobs come before it. The heaps are linked through the jobs: nothing
 * is allocated, and nothing can fail. A zeroed queue is empty. The owner of the queue serialises all calls.
 */
#ifndef BVHD_POOL_QUEUE_H
#define BVHD_POOL_QUEUE_H

#include "daemon/pool/pool.h"

enum { POOL_QUEUE_CLASSES = 64 };

struct pool_queue {
    uint64_t filled; /* bit i is set while class i, with sizes in [2^i, 2^(i+1)), has jobs */
    struct pool_job *first[POOL_QUEUE_CLASSES]; /* the root of each class's heap, or NULL */
};

/* Returns whether `job` goes before `other`. No two queued jobs have the same order. */
static inline bool pool_queue_before(const struct pool_job *job, const struct pool_job *other)
{
    return job->priority != other->priority ? job->priority > other->priority : job->order < other->order;
}

/* Returns the size of a job; size 0 counts as 1. */
static inline uint64_t pool_queue_size(const struct pool_job *job)
{
    return job->size ? job->size : 1;
}

/* Returns the class of a size. */
static inline unsigned pool_queue_class(uint64_t size)
{
    return 63 - (unsigned)__builtin_clzll(size | 1);
}

/* Adds a job, in O(1). Its priority, size and order must not change while it is in the queue. */
void pool_queue_put(struct pool_queue *queue, struct pool_job *job);

/* Removes a job that is in the queue, first or not, in amortised O(log n). */
void pool_queue_remove(struct pool_queue *queue, struct pool_job *job);

/* Returns the first job, which stays in the queue, or NULL if the queue is empty. */
struct pool_job *pool_queue_first(const struct pool_queue *queue);

/*
 * Returns the first among the jobs of size <= `most`, or NULL. In the class of `most` itself only the first job is
 * checked, so other jobs of that class can be missed.
 */
struct pool_job *pool_queue_first_small(const struct pool_queue *queue, uint64_t most);

#endif
