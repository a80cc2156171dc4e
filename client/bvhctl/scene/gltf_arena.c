/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_arena.h"

#include <cjson/cJSON.h>
#include <stdlib.h>

enum { SMALLEST_BLOCK = 1 << 16, LARGEST_BLOCK = 1 << 26, BLOCKS_A_TEXT = 4, UNIT = 16 };

struct gltf_block {
    struct gltf_block *next;
    size_t used, size; /* both with this header */
} __attribute__((aligned(UNIT)));

/* The arena that cJSON allocates from in this thread; NULL: it uses malloc. */
static _Thread_local struct gltf_arena *current;

static bool add_block(struct gltf_arena *arena, size_t least)
{
    size_t wanted = least + sizeof(struct gltf_block);
    size_t size = wanted > arena->block_size ? wanted : arena->block_size;
    struct gltf_block *block = memory_alloc(&arena->memory, size);
    if (!block)
        return false;
    *block = (struct gltf_block){arena->blocks, sizeof *block, size};
    arena->blocks = block;
    return true;
}

static void *allocate(size_t size)
{
    struct gltf_arena *arena = current;
    if (!arena)
        return malloc(size);
    size = (size + UNIT - 1) / UNIT * UNIT;
    struct gltf_block *block = arena->blocks;
    if ((!block || size > block->size - block->used) && !add_block(arena, size)) {
        arena->failed = true;
        return NULL;
    }
    block = arena->blocks;
    block->used += size;
    return (char *)block + block->used - size;
}

/*
 * Frees memory from outside of arenas. The memory of an arena is freed together with it, so this does nothing while
 * one is current; afterwards nobody may delete the JSON of an arena.
 */
static void release(void *data)
{
    if (!current)
        free(data);
}

const struct cJSON *gltf_arena_parse(struct gltf_arena *arena, const char *text, size_t size, const char **ret_end)
{
    static cJSON_Hooks hooks = {allocate, release};
    memory_init(&arena->memory, UINT64_MAX);
    size_t wanted = size / SMALLEST_BLOCK < LARGEST_BLOCK / SMALLEST_BLOCK ? size * BLOCKS_A_TEXT : LARGEST_BLOCK;
    arena->block_size = wanted < SMALLEST_BLOCK ? SMALLEST_BLOCK : wanted > LARGEST_BLOCK ? LARGEST_BLOCK : wanted;
    cJSON_InitHooks(&hooks); /* they stay, and are malloc and free without a current arena */
    current = arena;
    const cJSON *root = size ? cJSON_ParseWithLengthOpts(text, size, ret_end, 0) : NULL;
    current = NULL;
    return root;
}

void gltf_arena_finish(struct gltf_arena *arena)
{
    while (arena->blocks) {
        struct gltf_block *next = arena->blocks->next;
        memory_free(&arena->memory, arena->blocks);
        arena->blocks = next;
    }
}
