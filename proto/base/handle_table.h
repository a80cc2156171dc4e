/* SPDX-License-Identifier: Apache-2.0 */
/*
 * handle_table.h - a table of 64-bit handles, each with a number, sorted for look-up.
 *
 * Handles come from outside, so that the cost must not depend on how they are chosen. Therefore the table uses a radix
 * sort and a binary search instead of a hash.
 */
#ifndef BVHD_HANDLE_TABLE_H
#define BVHD_HANDLE_TABLE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#define HANDLE_NONE UINT32_MAX

/* One handle and its number. */
struct handle_entry {
    uint64_t handle;
    uint32_t number;
};

/* Sorts entries[count] by handle; the sort is stable. scratch[count] is overwritten. */
void handle_sort(struct handle_entry *entries, struct handle_entry *scratch, uint32_t count);

/*
 * Sorts in the same way, but gives up when *cancel is set: then it returns false and leaves the entries in any order,
 * possibly with duplicates. `cancel` may be NULL.
 */
bool handle_sort_until(struct handle_entry *entries, struct handle_entry *scratch, uint32_t count,
                       const atomic_bool *cancel);

/* Returns the position of the first entry with that handle in sorted entries, or HANDLE_NONE. */
uint32_t handle_find(const struct handle_entry *entries, uint32_t count, uint64_t handle);

#endif
