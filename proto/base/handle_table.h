/* SPDX-License-Identifier: Apache-2.0 */
/*
 * handle_table.h - 64-bit handles and the number that each stands for, sorted for look-up.
 *
 * Handles come from outside, so the cost must not depend on how they are chosen: a radix sort and a binary search, no
 * hash.
 */
#ifndef BVHD_HANDLE_TABLE_H
#define BVHD_HANDLE_TABLE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#define HANDLE_NONE UINT32_MAX

struct handle_entry {
    uint64_t handle;
    uint32_t number;
};

/* Sorts entries[count] by handle, stable; scratch[count] is overwritten. */
void handle_sort(struct handle_entry *entries, struct handle_entry *scratch, uint32_t count);

/*
 * The same, but gives up when *cancel is set: false, with the entries in any order, some maybe twice. `cancel` may be
 * NULL.
 */
bool handle_sort_until(struct handle_entry *entries, struct handle_entry *scratch, uint32_t count,
                       const atomic_bool *cancel);

/* Position of the first entry with that handle in sorted entries, or HANDLE_NONE. */
uint32_t handle_find(const struct handle_entry *entries, uint32_t count, uint64_t handle);

#endif
