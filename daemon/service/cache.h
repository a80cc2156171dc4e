/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cache.h - results that may be wanted again: blobs by key, least recently used first out, within a budget of bytes.
 *
 * An entry is a blob with its side data; what leaves the cache lives on while somebody holds it. Errors, cancellations
 * and shortages are never kept. Loop thread only.
 */
#ifndef BVHD_CACHE_H
#define BVHD_CACHE_H

#include "daemon/service/blob.h"

/*
 * What a blob costs beside its bytes, which for a memfd are counted in whole pages: its struct (some 350 bytes), the
 * entry and its slot (100), the headers of their memory, and for a memfd the kernel's inode, file and directory entry
 * (1,100).
 */
enum { CACHE_OVERHEAD = 2048, CACHE_PAGE = 4096 };

enum { CACHE_TRIM_MOST = 512 }; /* entries that go in one call: less than a millisecond of the loop */

struct cache;

/* `budget`: bytes that may be kept, counted as above; 0 keeps nothing. NULL without memory. */
struct cache *cache_create(uint64_t budget, struct memory *memory);
void cache_destroy(struct cache *cache);

/*
 * Answers by callback, which for what is in memory comes before cache_get returns; `blob` is NULL when the key is
 * unknown, and is borrowed: who keeps it takes a ref. A hit becomes the most recently used. The callback may use the
 * cache.
 */
typedef void (*cache_answer)(void *context, struct blob *blob);
void cache_get(struct cache *cache, const struct key *key, cache_answer answer, void *context);

/*
 * Keeps a ref, as the most recently used; others may have to go, the least recently used first. Not kept: a blob over
 * the whole budget, one whose key is there, any without memory for the entry. Descriptors are scarce too: of blobs that
 * have one, at most as many are kept as half of what the process may open.
 */
void cache_put(struct cache *cache, struct blob *blob);

/*
 * A large result may push out many small ones. cache_put lets go of CACHE_TRIM_MOST at once, this of as many more: true
 * while some are left, and the cache is over its budget until they have gone.
 */
bool cache_trim(struct cache *cache);

struct cache_load {
    uint64_t entries, bytes, evicted, budget; /* bytes as counted above; evicted: entries so far */
};

struct cache_load cache_load(const struct cache *cache);

#endif
