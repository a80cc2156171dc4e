/* SPDX-License-Identifier: Apache-2.0 */
/*
 * mapping.h - large blocks of memory on huge pages, and a cache of unused blocks that a process keeps for reuse.
 * (Obtaining and clearing pages costs a tenth of a build's time.)
 *
 * The cache is lazy: the system may take the pages of a cached block when it needs them, and the next user then gets
 * new pages. All functions may be called from any thread.
 */
#ifndef BVHD_MAPPING_H
#define BVHD_MAPPING_H

#include <stdint.h>

/*
 * Returns a mapping of *ret_length >= length bytes, at most a quarter longer than requested; both lengths are multiples
 * of 4096. It begins on a boundary of 2 MiB, and its contents are undefined. NULL if there is no memory.
 */
void *mapping_obtain(uint64_t length, uint64_t *ret_length);

/* Unmaps a mapping or puts it into the cache. `length` is the mapping's full length (*ret_length). */
void mapping_release(void *mapping, uint64_t length);

/*
 * Changes the length of a mapping to `length`, a multiple of 4096, by moving pages instead of copying them, and returns
 * its new address. Returns NULL if there is no memory; the old mapping is then unchanged.
 */
void *mapping_resize(void *mapping, uint64_t old_length, uint64_t length);

/*
 * Sets how many bytes the cache keeps from now on; 0 at first. Blocks beyond the limit are unmapped, the longest unused
 * first.
 */
void mapping_keep(uint64_t limit);

#endif
