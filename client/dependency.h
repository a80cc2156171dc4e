/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dependency.h - top levels that wait for what is not known yet of the bottom levels that they name: the results of
 * other items of their batch, or the bounds that belong to a key.
 *
 * Bounds are looked up by a batch of keys, which belongs to the batch that needs them. A top level is ITEM_BLOCKED
 * until all is known; then it is an ordinary item. It fails when a bottom level or a lookup fails. All functions
 * require the client's lock, except dependency_make.
 */
#ifndef BVHD_DEPENDENCY_H
#define BVHD_DEPENDENCY_H

#include "client/client_batch.h"
#include "client/reference_table.h"

/* One reference of a top level that is not complete. */
struct dependency {
    uint32_t item; /* the top level's position in the batch */
    uint32_t slot; /* the reference's position in the item's description */
    uint32_t next; /* the next dependency on the same source; DEPENDENCY_NONE: none */
};

#define DEPENDENCY_NONE UINT32_MAX

/* The dependencies of one batch. */
struct dependencies {
    struct dependency *all;
    uint32_t count;
    uint32_t *on_items; /* for each item of the batch: the first dependency on it */
    uint32_t *on_keys; /* for each item of `lookup`: the first dependency on it */
    uint32_t *numbers; /* for each item of `lookup`: its position in build.references */
    struct bvhd_batch *lookup; /* NULL: no bounds have to be looked up */
};

/*
 * Finds the dependencies of a batch that nothing else knows yet, and blocks its top levels that have some; their
 * instances are copied. Returns BVHD_NO_MEMORY.
 */
enum bvhd_status dependency_make(struct bvhd_batch *batch, const struct reference_table *table);

/* Tells the top levels that depend on an item, of a batch or of its lookup, that it is done. */
void dependency_settle(struct bvhd_batch *batch, uint32_t item);

/* Frees the dependencies, but not the batch that looks up bounds. NULL is allowed. */
void dependency_destroy(struct dependencies *dependencies);

#endif
