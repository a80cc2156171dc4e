/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_limits.h - limits of a process in which assimp reads files: memory and processor time in proportion to the
 * bytes of the files that it opens, so that a few bytes cannot keep a machine busy.
 *
 * The signal SIGPROF ends a process that takes more time; allocations beyond the memory fail. Under a sanitizer memory
 * is not limited, because its shadow memory takes terabytes of address space, and there is more time.
 */
#ifndef BVHCTL_IMPORT_LIMITS_H
#define BVHCTL_IMPORT_LIMITS_H

#include <stdint.h>

/*
 * Limits this process to what a file of no bytes may take, `factor` times, and disables core files. Call it once, in a
 * new process with one thread.
 */
void import_limits_set(unsigned factor);

/* Raises the limits for a file of `size` bytes. Does nothing in a process that is not limited. */
void import_limits_allow(uint64_t size);

/* Returns how many bytes this process may allocate, for messages. 0: as many as the machine has. */
uint64_t import_limits_memory(void);

#endif
