/* SPDX-License-Identifier: Apache-2.0 */
/*
 * heap.h - keeps malloc's heaps small in a daemon that runs for months. Each thread has a heap, which keeps freed
 * memory for the next builds, and in which free memory lies between blocks that are in use.
 */
#ifndef BVHD_HEAP_H
#define BVHD_HEAP_H

#include <stdint.h>

enum { HEAP_DIVISOR = 32 };

/* Bounds what the heaps keep, all together, to the budget divided by HEAP_DIVISOR, for a process of `threads`. */
void heap_limit(uint64_t budget, unsigned threads);

/*
 * Gives the free pages of all heaps back to the system, on a thread of its own, since that takes milliseconds. Does
 * nothing while an earlier call still works, or when no thread can be started. For any thread.
 */
void heap_trim(void);

#endif
