/* SPDX-License-Identifier: Apache-2.0 */
/*
 * release.h - closing and unmapping what would keep the caller, who may be the loop. Threads of the module's own do it,
 * a moment later. What is not closed yet lingers (descriptors.h), so its count may be given back at once. From any
 * thread.
 *
 * The system takes some 50 us for each MiB of a memfd's pages, wherever the last hold on them ends: small ones go at
 * once, those of RELEASE_LATER_MIN bytes and more later.
 */
#ifndef BVHD_RELEASE_H
#define BVHD_RELEASE_H

#include <stdint.h>

enum { RELEASE_LATER_MIN = 1024 * 1024 };

void release_mapping(void *address, uint64_t size);

/* A memfd of `size` bytes, of our own making. */
void release_memfd(int descriptor, uint64_t size);

/*
 * What a client sent, whatever it is, or a socket on which a client may have sent descriptors that were not received.
 * Closing either may take as long as somebody likes: a file of a FUSE file system waits for that file system's answer,
 * a TCP socket, also one that lies unread in another socket, for its SO_LINGER. So each has a thread of its own, unless
 * RELEASE_STRANGERS wait already. Nothing happens when it is not open.
 */
enum { RELEASE_STRANGERS = 64 };

void release_descriptor(int descriptor);

#endif
