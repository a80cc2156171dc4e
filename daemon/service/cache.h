/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cache.h - keeps results that may be wanted again: blobs by key, within a budget of bytes. The least recently used
 * ones are evicted first.
 *
 * An entry is a ref to a blob, so an evicted blob lives on while a reply holds it. Only results are kept, never errors,
 * cancellations or shortages. For the loop thread only.
 */
#ifndef BVHD_CACHE_H
#define BVHD_CACHE_H

#include "daemon/service/blob.h"

/*
 * CACHE_OVERHEAD is what a blob costs beside its bytes and its record: its struct (about 350 bytes), the entry and its
 * slot (100), the headers of their memory blocks, and for a memfd the kernel's inode, file and directory entry (1,100).
 * The bytes of a memfd are counted in whole pages of CACHE_PAGE.
 */
enum { CACHE_OVERHEAD = 2048, CACHE_PAGE = 4096 };

/* The most entries that are evicted in one call: this takes the loop less than a millisecond. */
enum { CACHE_TRIM_MOST = 512 };

struct cache;

/* `budget` is the most bytes that are kept, counted as above; 0 keeps nothing. Returns NULL without memory. */
struct cache *cache_create(uint64_t budget, struct memory *memory);
void cache_destroy(struct cache *cache);

/* Changes the budget. What exceeds a smaller one is evicted by cache_trim. */
void cache_resize(struct cache *cache, uint64_t budget);

/*
 * Looks a key up and answers by a callback, which is called before cache_get returns, and may use the cache itself.
 * `blob` is NULL if the key is unknown; else it is borrowed, and becomes the most recently used.
 */
typedef void (*cache_answer)(void *context, struct blob *blob);
void cache_get(struct cache *cache, const struct key *key, cache_answer answer, void *context);

/*
 * Keeps a ref to the blob, as the most recently used, and evicts others as cache_trim does. The blob is not kept if it
 * exceeds the whole budget, if its key is there already, or if there is no memory for the entry. Descriptors have a
 * budget too: at most half of those that the process may open belong to blobs of the cache.
 */
void cache_put(struct cache *cache, struct blob *blob);

/*
 * Evicts up to CACHE_TRIM_MOST entries while the cache is over its budget or has forgotten ones. Returns true if it
 * still is or has. A large result may push out many small ones, and then cache_put alone does not get back to the
 * budget.
 */
bool cache_trim(struct cache *cache);

/* Forgets all entries, which cache_trim then evicts as if they exceeded the budget. */
void cache_clear(struct cache *cache);

struct cache_load {
    uint64_t entries;
    uint64_t bytes, budget; /* counted as above */
    uint64_t evicted; /* entries so far */
};

struct cache_load cache_load(const struct cache *cache);

#endif
