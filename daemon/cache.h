/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cache.h - results that may be wanted again: blobs by key, least recently used first out, within a budget of bytes.
 *
 * An entry is a blob with its side data; what leaves the cache lives on while somebody holds it. Errors, cancellations and shortages are
 * never kept. Loop thread only.
 */
#ifndef BVHD_CACHE_H
#define BVHD_CACHE_H

#include "blob.h"

struct cache;

/* `budget`: bytes of blobs, with a fixed overhead for each, that may be kept; 0 keeps nothing. NULL without memory. */
struct cache *cache_create(uint64_t budget, struct memory *memory);
void cache_destroy(struct cache *cache);

/*
 * Answers by callback, which for what is in memory comes before cache_get returns; `blob` is NULL when the key is unknown, and is borrowed:
 * who keeps it takes a ref. A hit becomes the most recently used.
 */
typedef void (*cache_answer)(void *context, struct blob *blob);
void cache_get(struct cache *cache, const struct key *key, cache_answer answer, void *context);

/* Keeps a ref; others may have to go. A blob over the whole budget is not kept, nor one whose key is there. */
void cache_put(struct cache *cache, struct blob *blob);

struct cache_load {
    uint64_t entries, bytes, evicted, budget;
};

struct cache_load cache_load(const struct cache *cache);

#endif
