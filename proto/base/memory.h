/* SPDX-License-Identifier: Apache-2.0 */
/*
 * memory.h - the interface through which the builder allocates everything that grows with its input.
 *
 * A struct memory is a budget: it counts the live bytes and their peak, refuses allocations beyond the limit, and can
 * make the n-th allocation fail for tests. It counts the sizes that were requested. All functions may be called from
 * any thread. Blocks are 64-byte aligned and uninitialised. Blocks of 4 MiB and more are mappings of their own on huge
 * pages: the first touch of 256 MiB takes a third of the time that it takes with small pages, and a block grows by
 * moving pages instead of bytes.
 */
#ifndef BVHD_MEMORY_H
#define BVHD_MEMORY_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct bvhd_error;

/* A budget. The counters may be read at any time. */
struct memory {
    struct memory *parent; /* its allocations count there too; NULL for an independent budget */
    uint64_t limit; /* bytes that may be live at once; UINT64_MAX: no limit */
    _Atomic uint64_t live; /* bytes allocated now */
    _Atomic uint64_t peak; /* the most bytes that were live at once */
    /* For tests. < 0: never; n >= 0: the allocation after n further successes fails, and all later ones succeed. */
    _Atomic int64_t fail_after;
    /*
     * The bytes that would have been live after the allocation that failed last, in this budget or in that of its
     * parents which refused, and the limit there; 0: none has failed.
     */
    _Atomic uint64_t refused, refused_limit;
};

/* Starts a budget without a parent. It needs no clean-up. */
void memory_init(struct memory *memory, uint64_t limit);

/*
 * Starts a budget within another one, which must outlive it. Each allocation counts in both, and either can refuse it,
 * by its limit or by its fail_after. It needs no clean-up: once all its blocks are freed or handed up, the parent
 * counts nothing for it.
 */
void memory_init_within(struct memory *memory, struct memory *parent, uint64_t limit);

/*
 * Makes freed blocks stay with the process instead of going back to the system after each build: up to 32 MiB for each
 * heap of malloc and, lazily (mapping.h), 256 MiB of large blocks. For programs that build again and again: builds take
 * a tenth less time, and threads do not wait for each other in the kernel. Call it once, at the start.
 */
void memory_keep(void);

/* Lets each heap of malloc keep at most `most` bytes from now on, but at least 128 KiB and at most 32 MiB. */
void memory_keep_heap(uint64_t most);

/* Returns NULL if the budget, the machine or a test refuses, and if size is 0. */
void *memory_alloc(struct memory *memory, uint64_t size);

/* Allocates count * size bytes as memory_alloc does; returns NULL on overflow too. */
void *memory_array(struct memory *memory, uint64_t count, uint64_t size);

/*
 * Works like realloc. On failure, and if size is 0, it returns NULL and the old block stays. `block` may be NULL.
 * During a copy both blocks count; a large block that stays large counts only the difference.
 */
void *memory_resize(struct memory *memory, void *block, uint64_t size);

/*
 * Counts `size` bytes that a foreign library is about to allocate, as if they were a block; memory_release ends that.
 * Returns false if the budget or a test refuses.
 */
bool memory_reserve(struct memory *memory, uint64_t size);
void memory_release(struct memory *memory, uint64_t size);

/*
 * Transfers a block to the parent of `memory` (there must be one), through which it is freed from then on. It no longer
 * counts in `memory`. NULL is allowed.
 */
void memory_hand_up(struct memory *memory, void *block);

/*
 * Appends to the text of a BVHD_NO_MEMORY error how many bytes were needed at least, and what the limit is, if an
 * allocation of `memory` has failed and the text does not say so yet. Other errors, and NULL, are left alone.
 */
void memory_explain(const struct memory *memory, struct bvhd_error *error);

/* Frees a block that came from the same struct memory. NULL is allowed. */
void memory_free(struct memory *memory, void *block);

#endif
