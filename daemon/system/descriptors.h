/* SPDX-License-Identifier: Apache-2.0 */
/*
 * descriptors.h - how many file descriptors the process is still allowed to open. The daemon counts them itself, so
 * that it notices a shortage before the system reports it: when none is left, the kernel drops a received descriptor
 * without an error. All functions but descriptors_init can be called from any thread.
 */
#ifndef BVHD_DESCRIPTORS_H
#define BVHD_DESCRIPTORS_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

/*
 * DESCRIPTORS_MESSAGE is the most that the kernel delivers with one message. Code that opens descriptors for anything
 * else than receiving leaves DESCRIPTORS_RESERVE free, so that a message can always be received as a whole: those for
 * which there is no room would be closed by the kernel, within the call. DESCRIPTORS_OWN of the reserve are for files
 * that the daemon and its libraries open for a moment without counting them. DESCRIPTORS_LEAST is how many a daemon
 * needs to serve anybody.
 */
enum {
    DESCRIPTORS_MESSAGE = 253,
    DESCRIPTORS_OWN = 64,
    DESCRIPTORS_RESERVE = DESCRIPTORS_MESSAGE + DESCRIPTORS_OWN,
    DESCRIPTORS_LEAST = DESCRIPTORS_RESERVE + 128,
};

struct descriptors {
    uint32_t limit; /* RLIMIT_NOFILE minus the descriptors that were open at the start */
    _Atomic uint32_t used; /* by descriptors_take, not yet given back */
    /* descriptors sent to clients that have not read them; the kernel limits how many of these a user has */
    _Atomic uint32_t unread;
};

/*
 * Raises the process's soft limit to the hard one, and counts the open descriptors. To be called once, before other
 * threads open descriptors.
 */
void descriptors_init(struct descriptors *descriptors);

/*
 * Counts `count` descriptors that the caller is about to open. Returns false, and counts none, when fewer than `count`
 * + `keep` are left. `keep` is at least DESCRIPTORS_RESERVE, or DESCRIPTORS_OWN for those that are about to be
 * received.
 */
bool descriptors_take(struct descriptors *descriptors, uint32_t count, uint32_t keep);

/* Gives back `count` of the descriptors that were taken, after they were closed or handed to release_memfd. */
void descriptors_give(struct descriptors *descriptors, uint32_t count);

/* Returns how many descriptors can still be opened. */
uint32_t descriptors_left(const struct descriptors *descriptors);

/*
 * For release.h only, which closes a descriptor later than its owner has given back its count.
 * descriptors_linger counts one such descriptor as still open, descriptors_lingered as closed. The count is one for the
 * whole process, and descriptors_take and descriptors_left of every struct descriptors subtract it.
 */
void descriptors_linger(void);
void descriptors_lingered(void);

/*
 * descriptors_send counts descriptors that are about to be sent to a client. It returns false, and counts none, when
 * all clients together would then have more than half of the limit unread. descriptors_read counts those that a client
 * has read, or that were not sent after all.
 */
uint32_t descriptors_sendable(const struct descriptors *descriptors); /* how many descriptors_send would count */
bool descriptors_send(struct descriptors *descriptors, uint32_t count);
void descriptors_read(struct descriptors *descriptors, uint32_t count);

#endif
