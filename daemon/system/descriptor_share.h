/* SPDX-License-Identifier: Apache-2.0 */
/*
 * descriptor_share.h - what each user of the machine holds of the daemon's descriptors, so that no user can take those
 * that others need.
 *
 * A descriptor that a client causes the daemon to hold (its connection, what it sent, and of these what is not closed
 * yet) is charged to the client's user until it is closed, however long that takes. A user may hold at most as many as
 * are still left for others. So one user alone gets half of what there is, two get a third each, and whoever comes next
 * always finds some. The same rule holds for results on their way to clients, of which the kernel allows the daemon a
 * number of its own (descriptors.h).
 *
 * A share belongs to the process and is never freed, because a thread may still be closing one of its descriptors when
 * the service has ended. One that nobody uses any more serves the next user. Unless it is said otherwise, functions are
 * for the loop thread.
 */
#ifndef BVHD_DESCRIPTOR_SHARE_H
#define BVHD_DESCRIPTOR_SHARE_H

#include "daemon/system/descriptors.h"

/* Uids that no user has, for shares of clients that are not told apart by user. */
#define DESCRIPTOR_SHARE_NOBODY UINT32_MAX
#define DESCRIPTOR_SHARE_METRICS (UINT32_MAX - 1)

struct descriptor_share {
    struct descriptor_share *next; /* of all shares */
    struct descriptors *descriptors;
    uint32_t uid;
    uint32_t holders; /* connections */
    _Atomic uint32_t used; /* descriptors that are not closed yet */
    uint32_t unread; /* descriptors that were sent and may not have been read */
};

/* Returns the share of the user with this uid, for as long as descriptor_share_close is not called; NULL: no memory. */
struct descriptor_share *descriptor_share_open(struct descriptors *descriptors, uint32_t uid);
void descriptor_share_close(struct descriptor_share *share);

/* Returns whether the user may hold `count` descriptors more. */
bool descriptor_share_has_room(const struct descriptor_share *share, uint32_t count);

/* Charges `count` descriptors to the user, which descriptors_take has counted. */
void descriptor_share_add(struct descriptor_share *share, uint32_t count);

/* Gives back `count` descriptors that were charged and are closed now. For any thread. */
void descriptor_share_give(struct descriptor_share *share, uint32_t count);

/*
 * These two are for release.h, which closes a descriptor later: the first one is called at once and gives it back to
 * the service, the second one, when it is closed, gives it back to the user. For any thread; `share` may be NULL.
 */
void descriptor_share_linger(struct descriptor_share *share);
void descriptor_share_lingered(struct descriptor_share *share);

/*
 * descriptor_share_send counts a descriptor that is about to be sent to one of the user's clients. It returns false,
 * and counts none, when the user has as many unread as are left for others, or none are left. descriptor_share_read
 * counts those that were read, or not sent after all.
 */
bool descriptor_share_send(struct descriptor_share *share);
void descriptor_share_read(struct descriptor_share *share, uint32_t count);

#endif
