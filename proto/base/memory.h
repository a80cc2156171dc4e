/* SPDX-License-Identifier: Apache-2.0 */
/*
 * memory.h - the seam through which the builder allocates whatever grows with its input.
 *
 * A struct memory is a budget: it counts what is live and the peak, refuses what would pass the limit, and can be told
 * to fail the n-th allocation (tests). What counts are the sizes that were asked for. Functions are safe from any
 * thread. Blocks are 64-byte aligned; blocks of 4 MiB and more are mappings of their own, laid for huge pages: the
 * first touch of 256 MiB takes a third of the time that it takes with small pages, and a block grows by moving pages
 * instead of bytes. Contents are uninitialised.
 */
#ifndef BVHD_MEMORY_H
#define BVHD_MEMORY_H

#include <stdatomic.h>
#include <stdint.h>

struct memory {
    struct memory *parent; /* what is allocated here counts there too; NULL for a budget of its own */
    uint64_t limit; /* bytes that may be live at once; UINT64_MAX = no limit */
    _Atomic uint64_t live; /* bytes now */
    _Atomic uint64_t peak; /* the most that were live at once */
    /* < 0: never; n >= 0: the allocation after n more successes fails, and all later ones succeed */
    _Atomic int64_t fail_after;
};

void memory_init(struct memory *memory, uint64_t limit);

/*
 * A budget within another one, which must outlive it: each allocation counts in both, and either refuses it, by its
 * limit or by its fail_after. Needs no end; when all its blocks are freed or handed up nothing of it is left in the
 * parent.
 */
void memory_init_within(struct memory *memory, struct memory *parent, uint64_t limit);

/*
 * For programs that build again and again: what blocks leave behind stays with the process instead of going back to the
 * system after each build, up to 32 MiB a heap of malloc and, lazily (mapping.h), 256 MiB of large blocks. Builds gain
 * a tenth, and threads do not wait for each other in the kernel. Once, at the start.
 */
void memory_keep(void);

/* NULL when the budget, the machine or the test says no, or when size is 0. */
void *memory_alloc(struct memory *memory, uint64_t size);

/* As memory_alloc, for count * size, NULL also on overflow. */
void *memory_array(struct memory *memory, uint64_t count, uint64_t size);

/*
 * Like realloc; on failure, and when size is 0, the old block lives on and NULL is returned. block may be NULL. While
 * bytes are copied both blocks count; a large block that stays large counts only the difference.
 */
void *memory_resize(struct memory *memory, void *block, uint64_t size);

/*
 * Makes a block the parent's, through which it is freed from then on; it no longer counts in `memory`, which has a
 * parent. NULL-safe.
 */
void memory_hand_up(struct memory *memory, void *block);

/* block may be NULL. The block must come from the same struct memory. */
void memory_free(struct memory *memory, void *block);

#endif
