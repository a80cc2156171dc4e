/* SPDX-License-Identifier: Apache-2.0 */
/*
 * release.h - closes and unmaps without blocking the caller, who may be the loop: calls that could take long are made a
 * moment later, on threads of this module. A descriptor that is not closed yet lingers (descriptors.h). All functions
 * can be called from any thread; none reports an error.
 *
 * Freeing the pages of a memfd takes the system 50 to 200 us for each MiB, when the last reference to them goes. Small
 * ones are therefore released at once, those of RELEASE_LATER_MIN bytes and more later.
 */
#ifndef BVHD_RELEASE_H
#define BVHD_RELEASE_H

#include "daemon/system/descriptor_share.h"

enum { RELEASE_LATER_MIN = 1024 * 1024 };

/*
 * Begins the slow releases that the calling thread has asked for. The loop calls it each time that it has written its
 * replies, so that no client waits for memory to be freed. Once a thread has called it, its slow releases of mappings
 * and memfds wait for its next call.
 */
void release_flush(void);

/* Unmaps `size` bytes at `address`. */
void release_mapping(void *address, uint64_t size);

/* Closes a memfd of `size` bytes that this process has made. The caller gives back its count. */
void release_memfd(int descriptor, uint64_t size);

/*
 * Closes a descriptor that a client sent, of whatever kind, or a socket on which a client may have sent descriptors
 * that were not received. It is counted (descriptors_take) and charged to `share`, and the call gives back both: the
 * former at once, the latter when it is closed. `share` may be NULL for a descriptor that is not counted.
 *
 * How long such a close() blocks is decided by somebody else: a file of a FUSE file system waits for that file system's
 * answer, and a TCP socket, even one that is unread in another socket, for its SO_LINGER. Each is therefore closed on a
 * thread of its own, at most RELEASE_FOREIGN_THREADS at the same time; more of them queue. So nothing that the daemon
 * needs may wait here: memfds are closed as by release_memfd, and clients' sockets only come here while descriptors are
 * unread in them (inlet.h).
 */
enum { RELEASE_FOREIGN_THREADS = 64 };

void release_descriptor(struct descriptor_share *share, int descriptor);

#endif
