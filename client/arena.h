/* SPDX-License-Identifier: Apache-2.0 */
/*
 * arena.h - places within a block of memory that somebody else owns, given back in any order. Takes the lowest place
 * that fits, so that little of the block is ever touched. Not safe from several threads at once.
 */
#ifndef BVHD_ARENA_H
#define BVHD_ARENA_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

/* Places begin and end at multiples of this. */
enum { ARENA_ALIGNMENT = 64 };

struct arena_range {
    uint64_t offset, size;
};

struct arena {
    struct memory *memory; /* of the list */
    struct arena_range *free_ranges; /* ascending, none empty, no two adjacent */
    uint32_t count, capacity;
    uint32_t taken; /* places that are out */
};

/* `size` is rounded down to the alignment. BVHD_NO_MEMORY shows as false. */
bool arena_init(struct arena *arena, struct memory *memory, uint64_t size);

/* What is out is forgotten. */
void arena_finish(struct arena *arena);

/* False when no range is large enough, when size is 0, or without memory for the list. */
bool arena_take(struct arena *arena, uint64_t size, uint64_t *ret_offset);

/* `size` as it was asked for. Never fails. */
void arena_give(struct arena *arena, uint64_t offset, uint64_t size);

#endif
