/* SPDX-License-Identifier: Apache-2.0 */
#include "client/arena.h"

#include <assert.h>
#include <string.h>

#include "proto/base/bytes.h"

enum { FIRST_CAPACITY = 16 };

bool arena_init(struct arena *arena, struct memory *memory, uint64_t size)
{
    struct arena_range *ranges = memory_array(memory, FIRST_CAPACITY, sizeof *ranges);
    if (!ranges)
        return false;
    *arena = (struct arena){.memory = memory, .free_ranges = ranges, .capacity = FIRST_CAPACITY};
    ranges[0] = (struct arena_range){0, size - size % ARENA_ALIGNMENT};
    arena->count = ranges[0].size > 0;
    return true;
}

void arena_finish(struct arena *arena)
{
    memory_free(arena->memory, arena->free_ranges);
    *arena = (struct arena){.memory = arena->memory};
}

/*
 * Between n ranges that are taken there are at most n + 1 free ranges. Therefore space for one more list entry is
 * reserved before a range is taken, so that giving it back needs none.
 */
static bool reserve(struct arena *arena)
{
    uint32_t needed = arena->taken + 2;
    if (needed <= arena->capacity)
        return true;
    struct arena_range *ranges =
        memory_resize(arena->memory, arena->free_ranges, (uint64_t)arena->capacity * 2 * sizeof *ranges);
    if (!ranges)
        return false;
    arena->free_ranges = ranges;
    arena->capacity *= 2;
    return true;
}

static void remove_range(struct arena *arena, uint32_t at)
{
    arena->count--;
    memmove(&arena->free_ranges[at], &arena->free_ranges[at + 1], (arena->count - at) * sizeof *arena->free_ranges);
}

bool arena_take(struct arena *arena, uint64_t size, uint64_t *ret_offset)
{
    if (size == 0 || size > UINT64_MAX - ARENA_ALIGNMENT)
        return false;
    size = bytes_align(size, ARENA_ALIGNMENT);
    for (uint32_t i = 0; i < arena->count; i++) {
        struct arena_range *range = &arena->free_ranges[i];
        if (range->size < size)
            continue;
        if (!reserve(arena))
            return false;
        range = &arena->free_ranges[i];
        *ret_offset = range->offset;
        range->offset += size;
        range->size -= size;
        if (range->size == 0)
            remove_range(arena, i);
        arena->taken++;
        return true;
    }
    return false;
}

/* Returns the index of the first free range that begins after `offset`. */
static uint32_t find_after(const struct arena *arena, uint64_t offset)
{
    uint32_t low = 0, high = arena->count;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (arena->free_ranges[middle].offset > offset)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

void arena_give(struct arena *arena, uint64_t offset, uint64_t size)
{
    size = bytes_align(size, ARENA_ALIGNMENT);
    uint32_t at = find_after(arena, offset);
    struct arena_range *ranges = arena->free_ranges;
    bool joins_before = at > 0 && ranges[at - 1].offset + ranges[at - 1].size == offset;
    bool joins_after = at < arena->count && offset + size == ranges[at].offset;
    assert(arena->taken > 0 && (at == 0 || ranges[at - 1].offset + ranges[at - 1].size <= offset));
    assert(at == arena->count || offset + size <= ranges[at].offset);
    arena->taken--;
    if (joins_before) {
        ranges[at - 1].size += size + (joins_after ? ranges[at].size : 0);
        if (joins_after)
            remove_range(arena, at);
    } else if (joins_after) {
        ranges[at] = (struct arena_range){offset, ranges[at].size + size};
    } else {
        assert(arena->count < arena->capacity);
        memmove(&ranges[at + 1], &ranges[at], (arena->count - at) * sizeof *ranges);
        ranges[at] = (struct arena_range){offset, size};
        arena->count++;
    }
}
