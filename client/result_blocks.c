/* SPDX-License-Identifier: Apache-2.0 */
#include "client/result_blocks.h"

#include <stdatomic.h>

#include "client/library.h"
#include "proto/base/bytes.h"

enum { BLOCK_SIZE = 4 << 20, ALIGNMENT = 64 };

struct result_block {
    atomic_uint refs; /* its results, and the batch that fills it */
    uint64_t used; /* bytes from the start of this struct on */
};

static struct result_block *create(void)
{
    struct result_block *block = memory_alloc(&library_memory, BLOCK_SIZE);
    if (!block)
        return NULL;
    *block = (struct result_block){.used = ALIGNMENT};
    atomic_init(&block->refs, 1);
    return block;
}

void result_block_unref(struct result_block *block)
{
    if (block && atomic_fetch_sub_explicit(&block->refs, 1, memory_order_acq_rel) == 1)
        memory_free(&library_memory, block);
}

void result_blocks_finish(struct result_blocks *blocks)
{
    result_block_unref(blocks->current);
    blocks->current = NULL;
}

static bool has_room(const struct result_block *block, uint64_t size)
{
    return block && size <= BLOCK_SIZE - block->used;
}

void *result_blocks_take(struct result_blocks *blocks, uint64_t size, struct result_block **ret_block)
{
    if (size > BLOCK_SIZE / 2 || blocks->received < RESULT_BLOCKS_FROM) {
        blocks->received += size;
        return NULL;
    }
    const uint64_t taken = bytes_align(size, ALIGNMENT);
    if (!has_room(blocks->current, taken)) {
        result_blocks_finish(blocks);
        blocks->current = create();
    }
    struct result_block *block = blocks->current;
    if (!block)
        return NULL;
    unsigned char *place = (unsigned char *)block + block->used;
    block->used += taken;
    atomic_fetch_add_explicit(&block->refs, 1, memory_order_relaxed);
    *ret_block = block;
    return place;
}
