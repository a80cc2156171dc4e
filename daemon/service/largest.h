/* SPDX-License-Identifier: Apache-2.0 */
/*
 * largest.h - the largest of numbers that come and go, rounded up by an eighth at most. Numbers are counted in buckets,
 * eight for each power of two, so nothing is allocated.
 */
#ifndef BVHD_LARGEST_H
#define BVHD_LARGEST_H

#include <assert.h>
#include <stdint.h>

enum { LARGEST_STEPS = 8, LARGEST_BUCKETS = 64 * LARGEST_STEPS };

/* Zeroed means that there are no numbers. */
struct largest {
    uint32_t counts[LARGEST_BUCKETS];
    uint32_t highest; /* no bucket above this one has numbers */
};

static inline uint32_t largest_bucket(uint64_t number)
{
    if (number < LARGEST_STEPS)
        return (uint32_t)number;
    uint32_t power = 63 - (uint32_t)__builtin_clzll(number);
    return (power - 2) * LARGEST_STEPS + (uint32_t)(number >> (power - 3)) % LARGEST_STEPS;
}

/* Returns the largest number of a bucket. */
static inline uint64_t largest_of_bucket(uint32_t bucket)
{
    if (bucket < LARGEST_STEPS)
        return bucket;
    uint32_t shift = bucket / LARGEST_STEPS - 1;
    uint64_t first = LARGEST_STEPS + bucket % LARGEST_STEPS;
    return (first << shift) + ((UINT64_C(1) << shift) - 1);
}

static inline void largest_add(struct largest *largest, uint64_t number)
{
    uint32_t bucket = largest_bucket(number);
    largest->counts[bucket]++;
    if (bucket > largest->highest)
        largest->highest = bucket;
}

/* Removes a number that was added. */
static inline void largest_remove(struct largest *largest, uint64_t number)
{
    uint32_t bucket = largest_bucket(number);
    assert(largest->counts[bucket] > 0);
    largest->counts[bucket]--;
    while (largest->highest > 0 && largest->counts[largest->highest] == 0)
        largest->highest--;
}

/* Returns 0 when there are no numbers. */
static inline uint64_t largest_get(const struct largest *largest)
{
    return largest_of_bucket(largest->highest);
}

#endif
