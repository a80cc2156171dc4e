/* SPDX-License-Identifier: Apache-2.0 */
/*
 * result_blocks.h - memory for the results of a batch that come inside frames. When there are many of them they share
 * blocks of 4 MiB, which lie on huge pages: faults on fresh small pages would take longer than all else that a client
 * does for such a result.
 *
 * A block lives as long as any result in it. The first RESULT_BLOCKS_FROM bytes of a batch do not use blocks, so that
 * the pages of a batch take at most about twice the bytes of its results.
 */
#ifndef BVHD_RESULT_BLOCKS_H
#define BVHD_RESULT_BLOCKS_H

#include <stdint.h>

enum { RESULT_BLOCKS_FROM = 2 << 20 };

/* A block, with a count of the results in it. */
struct result_block;

/* The state of one batch; all 0 at the start. It is used under the client's lock. */
struct result_blocks {
    uint64_t received; /* bytes of results so far */
    struct result_block *current; /* where the next result goes; NULL: into a new block */
};

/*
 * Returns 64-byte aligned memory for a result of `size` bytes, and its block, which the caller gives back with
 * result_block_unref. Returns NULL if the result is to have memory of its own: it is one of the first, it is larger
 * than half a block, or there is no memory for a block.
 */
void *result_blocks_take(struct result_blocks *blocks, uint64_t size, struct result_block **ret_block);

/* Lets go of the current block. */
void result_blocks_finish(struct result_blocks *blocks);

/* Frees the block if no other result is in it. It can be called from any thread; NULL is allowed. */
void result_block_unref(struct result_block *block);

#endif
