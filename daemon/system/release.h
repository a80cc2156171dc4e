/* SPDX-License-Identifier: Apache-2.0 */
/*
 * release.h - closes and unmaps without blocking the caller, who may be the loop: calls that could take long are made a
 * moment later, on threads of this module. A descriptor that is not closed yet lingers (descriptors.h), so its owner
 * gives back its count at once. All functions can be called from any thread; none reports an error.
 *
 * Freeing the pages of a memfd takes the system some 50 us for each MiB, when the last reference to them goes. Small
 * ones are therefore released at once, those of RELEASE_LATER_MIN bytes and more later.
 */
#ifndef BVHD_RELEASE_H
#define BVHD_RELEASE_H

#include <stdint.h>

enum { RELEASE_LATER_MIN = 1024 * 1024 };

/* Unmaps `size` bytes at `address`. */
void release_mapping(void *address, uint64_t size);

/* Closes a memfd of `size` bytes that this process has made. */
void release_memfd(int descriptor, uint64_t size);

/*
 * Closes a descriptor that a client sent, of whatever kind, or a socket on which a client may have sent descriptors
 * that were not received. How long such a close() blocks is decided by somebody else: a file of a FUSE file system
 * waits for that file system's answer, and a TCP socket, even one that is unread in another socket, for its SO_LINGER.
 * Each is therefore closed on a thread of its own, at most RELEASE_FOREIGN_THREADS at the same time; more of them
 * queue. A descriptor that is not open is ignored.
 */
enum { RELEASE_FOREIGN_THREADS = 64 };

void release_descriptor(int descriptor);

#endif
