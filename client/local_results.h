/* SPDX-License-Identifier: Apache-2.0 */
/*
 * local_results.h - finds by key the results that were built in this process and that a batch of the client still
 * holds. They answer later requests for the same structure. Requires the client's lock.
 */
#ifndef BVHD_LOCAL_RESULTS_H
#define BVHD_LOCAL_RESULTS_H

#include <stdbool.h>

#include "proto/base/key.h"

struct client_item;

/* An item's entry in the table. */
struct local_entry {
    struct client_item *next; /* with the same hash */
    bool is_listed;
};

/* A hash table of the items that hold such results. All 0 is an empty table. */
struct local_results {
    struct client_item **buckets; /* NULL: none yet */
    uint64_t mask; /* number of buckets - 1; the number is a power of two */
    uint64_t count;
};

/* Frees the table, in which no item is left. */
void local_results_finish(struct local_results *results);

/* Adds an item that is done and has its key and bytes. Without memory it is not added, and will not be found. */
void local_results_add(struct local_results *results, struct client_item *item);

/* Removes an item, if it was added. */
void local_results_remove(struct local_results *results, struct client_item *item);

/* Returns an item with that key, or NULL. */
const struct client_item *local_results_find(const struct local_results *results, const struct key *key);

#endif
