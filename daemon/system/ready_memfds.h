/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ready_memfds.h - memfds whose pages exist already, for results that are read from disk. It takes the system longer to
 * make a page than to fill it, so a thread of this module makes pages while nobody waits for them.
 *
 * Nothing is ready at the start. Each time that a memfd is asked for, one of about that size is prepared afterwards, so
 * as many of these sizes become ready as were missing, within a budget. When nobody has asked for a while, all are
 * given back and the thread ends. All functions are for any thread.
 */
#ifndef BVHD_READY_MEMFDS_H
#define BVHD_READY_MEMFDS_H

#include "daemon/system/descriptors.h"
#include "daemon/system/memfd.h"
#include "proto/base/memory.h"

/* The most memfds that are ready, and the smallest: fewer pages are made about as soon as a thread is woken. */
enum { READY_MOST = 32, READY_SIZE_MIN = 128 * 1024 };

struct ready_options {
    struct memory *memory; /* where the bytes count */
    struct descriptors *descriptors; /* where the descriptors count, of which DESCRIPTORS_RESERVE stay free */
    uint64_t budget; /* bytes of all memfds that are ready */
    unsigned most_readers; /* none are prepared while more threads than that read from disk */
    unsigned idle_ms; /* how long they stay ready while nobody asks */
};

struct ready_memfds;

/* What `options` points to must outlive it. BVHD_NO_MEMORY. */
enum bvhd_status ready_memfds_create(const struct ready_options *options, struct ready_memfds **ret_ready,
                                     struct bvhd_error *error);

/* Waits for the thread, and gives everything back. NULL-safe. */
void ready_memfds_destroy(struct ready_memfds *ready);

/* To be called before and after a thread reads from disk, so that preparing does not compete with many readers. */
void ready_memfds_enter(struct ready_memfds *ready);
void ready_memfds_leave(struct ready_memfds *ready);

/*
 * To be called by a reader. Hands over a memfd of at least `size` bytes and less than twice as many, with its mapping;
 * the caller counts it from now on. Returns false if none is ready.
 */
bool ready_memfds_take(struct ready_memfds *ready, uint64_t size, struct memfd *ret_memfd);

/*
 * Begins to prepare what is missing. It is a call of its own, so that the preparation does not compete with a thread
 * that reads, nor with the client that waits for the result.
 */
void ready_memfds_prepare(struct ready_memfds *ready);

struct ready_load {
    uint32_t count; /* memfds that are ready */
    uint32_t wanted; /* memfds that are still to be prepared */
    uint64_t bytes; /* of those that are ready, and of one that is being prepared */
};

struct ready_load ready_memfds_load(struct ready_memfds *ready);

#endif
