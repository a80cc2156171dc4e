/* SPDX-License-Identifier: Apache-2.0 */
/*
 * arena.h - allocates ranges within a block of memory that somebody else owns; they may be given back in any order. It
 * takes the lowest range that fits, so that as little of the block as possible is ever touched. The caller serialises
 * calls.
 */
#ifndef BVHD_ARENA_H
#define BVHD_ARENA_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

/* Ranges begin and end at multiples of this. */
enum { ARENA_ALIGNMENT = 64 };

struct arena_range {
    uint64_t offset, size;
};

/* The free ranges of one block. */
struct arena {
    struct memory *memory; /* for the list of ranges */
    struct arena_range *free_ranges; /* ascending, none empty, no two adjacent */
    uint32_t count, capacity;
    uint32_t taken; /* number of ranges that are taken */
};

/* Starts an arena over a block of `size` bytes, rounded down to the alignment. Returns false without memory. */
bool arena_init(struct arena *arena, struct memory *memory, uint64_t size);

/* Frees the list; ranges that are still taken are forgotten. */
void arena_finish(struct arena *arena);

/* Takes a range. Returns false if no free range is large enough, if size is 0, or without memory for the list. */
bool arena_take(struct arena *arena, uint64_t size, uint64_t *ret_offset);

/* Gives a range back, with the size that was requested. It never fails. */
void arena_give(struct arena *arena, uint64_t offset, uint64_t size);

#endif
