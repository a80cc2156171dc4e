/* SPDX-License-Identifier: Apache-2.0 */
/*
 * descriptors.h - how many file descriptors the process may still open. Counted, so that a shortage is met before the system reports it: with
 * none left, a received descriptor is lost without a trace. From any thread.
 */
#ifndef BVHD_DESCRIPTORS_H
#define BVHD_DESCRIPTORS_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct descriptors {
    uint32_t limit; /* RLIMIT_NOFILE less those that were open at the start */
    _Atomic uint32_t used;
    _Atomic uint32_t unread; /* descriptors sent to clients that have not read them: the kernel limits them for a user */
};

/* Raises the soft limit to the hard one, and counts what is open. */
void descriptors_init(struct descriptors *descriptors);

/* False when fewer than `count` + `keep` are left. Descriptors that are received count when they arrive. */
bool descriptors_take(struct descriptors *descriptors, uint32_t count, uint32_t keep);
void descriptors_give(struct descriptors *descriptors, uint32_t count);
uint32_t descriptors_left(const struct descriptors *descriptors);

/* At most half of the limit may be on its way unread, all clients together. */
bool descriptors_send(struct descriptors *descriptors, uint32_t count);
void descriptors_read(struct descriptors *descriptors, uint32_t count);

#endif
