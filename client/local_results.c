/* SPDX-License-Identifier: Apache-2.0 */
#include "client/local_results.h"

#include <string.h>

#include "client/client_batch.h"

enum { FIRST_BUCKETS = 64 };

void local_results_finish(struct local_results *results)
{
    memory_free(&library_memory, results->buckets);
    *results = (struct local_results){0};
}

/* Keys are cryptographic hashes, so any of their bytes are a good hash. */
static struct client_item **bucket_of(const struct local_results *results, const uint8_t *key)
{
    return &results->buckets[bytes_get64(key) & results->mask];
}

static void insert(struct local_results *results, struct client_item *item)
{
    struct client_item **bucket = bucket_of(results, item->result.key.bytes);
    item->local.entry.next = *bucket;
    *bucket = item;
}

/* Doubles the number of buckets. Without memory for that, the chains become longer. Returns false if there are none. */
static bool grow(struct local_results *results)
{
    uint64_t old_count = results->buckets ? results->mask + 1 : 0, count = old_count ? 2 * old_count : FIRST_BUCKETS;
    struct client_item **buckets = memory_array(&library_memory, count, sizeof *buckets), **old = results->buckets;
    if (!buckets)
        return old_count > 0;
    memset(buckets, 0, count * sizeof *buckets);
    results->buckets = buckets;
    results->mask = count - 1;
    for (uint64_t i = 0; i < old_count; i++)
        for (struct client_item *item = old[i], *next; item; item = next) {
            next = item->local.entry.next;
            insert(results, item);
        }
    memory_free(&library_memory, old);
    return true;
}

void local_results_add(struct local_results *results, struct client_item *item)
{
    bool is_full = !results->buckets || results->count > results->mask;
    if (is_full && !grow(results))
        return;
    insert(results, item);
    item->local.entry.is_listed = true;
    results->count++;
}

void local_results_remove(struct local_results *results, struct client_item *item)
{
    if (!item->local.entry.is_listed)
        return;
    struct client_item **at = bucket_of(results, item->result.key.bytes);
    while (*at != item)
        at = &(*at)->local.entry.next;
    *at = item->local.entry.next;
    item->local.entry.is_listed = false;
    results->count--;
}

const struct client_item *local_results_find(const struct local_results *results, const struct key *key)
{
    if (results->count == 0)
        return NULL;
    const struct client_item *item = *bucket_of(results, key->bytes);
    while (item && memcmp(item->result.key.bytes, key->bytes, sizeof key->bytes) != 0)
        item = item->local.entry.next;
    return item;
}
