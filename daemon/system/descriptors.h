/* SPDX-License-Identifier: Apache-2.0 */
/*
 * descriptors.h - how many file descriptors the process may still open. Counted, so that a shortage is met before the
 * system reports it: with none left, a received descriptor is lost without a trace. From any thread.
 */
#ifndef BVHD_DESCRIPTORS_H
#define BVHD_DESCRIPTORS_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

/*
 * What everything but receiving leaves free, so that a message that comes with descriptors can always be received
 * whole.
 */
enum { DESCRIPTORS_RESERVE = 16 };

struct descriptors {
    uint32_t limit; /* RLIMIT_NOFILE less those that were open at the start */
    _Atomic uint32_t used;
    /* descriptors sent to clients that have not read them: the kernel limits them for a user */
    _Atomic uint32_t unread;
};

/*
 * Raises the process's soft limit to the hard one, and counts what is open. Once, before threads open descriptors of
 * their own.
 */
void descriptors_init(struct descriptors *descriptors);

/*
 * All `count` or none: false when fewer than `count` + `keep` are left. `keep` is DESCRIPTORS_RESERVE, or 0 for
 * descriptors that have been received, which count when they arrive.
 */
bool descriptors_take(struct descriptors *descriptors, uint32_t count, uint32_t keep);
void descriptors_give(struct descriptors *descriptors, uint32_t count);
uint32_t descriptors_left(const struct descriptors *descriptors);

/*
 * For whoever closes later (release.h): one descriptor, whose count was given back, is still open; and no longer. Those
 * that linger count as used in every struct descriptors.
 */
void descriptors_linger(void);
void descriptors_lingered(void);

/*
 * Sending and having been read: false when more than half of the limit would be on its way unread, all clients
 * together.
 */
bool descriptors_send(struct descriptors *descriptors, uint32_t count);
void descriptors_read(struct descriptors *descriptors, uint32_t count);

#endif
