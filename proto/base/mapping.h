/* SPDX-License-Identifier: Apache-2.0 */
/*
 * mapping.h - large blocks of address space, laid for huge pages, and those that a process keeps for its next blocks:
 * to get pages and clear them costs a build a tenth of its time.
 *
 * What is kept is kept lazily: the system may take the pages when it needs them, and then the next user gets new ones.
 * Safe from any thread.
 */
#ifndef BVHD_MAPPING_H
#define BVHD_MAPPING_H

#include <stdint.h>

/*
 * *ret_length >= length bytes, both multiples of 4096, that begin on a boundary of 2 MiB; contents are of no meaning.
 * At most a quarter longer than was asked for. NULL when there is none.
 */
void *mapping_obtain(uint64_t length, uint64_t *ret_length);

/* Gives it back, or keeps it. `length` is all of the mapping. */
void mapping_release(void *mapping, uint64_t length);

/*
 * The mapping with another length, its pages moved instead of copied. NULL when there is none; then the old one is as
 * it was.
 */
void *mapping_resize(void *mapping, uint64_t old_length, uint64_t length);

/* From now on up to `limit` bytes are kept, 0 at first; what is over it goes, the longest unused first. */
void mapping_keep(uint64_t limit);

#endif
