/* SPDX-License-Identifier: Apache-2.0 */
/*
 * share.h - divides what the service has among users, and what a user has among its connections, so that nobody can
 * take all of it: the queue, memory for frames, payloads and results, descriptors.
 *
 * Shares form a tree: the service's root, with the limits; a share for each user; and below it one for each of the
 * user's connections. What a share uses counts in all shares above it. There are no fixed quotas: a share has room for
 * three quarters of what its siblings leave of their parent's room, so that one who is alone can have much and a
 * newcomer always finds something; and it has room for an equal part, with one part kept for a newcomer, so that those
 * who have more cannot go on until it has had as much. For the loop thread only.
 */
#ifndef BVHD_SHARE_H
#define BVHD_SHARE_H

#include <stdbool.h>
#include <stdint.h>

enum share_kind {
    SHARE_ITEMS, /* whose result has not been sent or dropped */
    SHARE_INLINE, /* bytes of payloads inside frames that are still needed */
    SHARE_POOL, /* bytes of clients' pools */
    SHARE_MEMFDS, /* that came with requests that have not ended */
    SHARE_RESULTS, /* bytes of results that clients have not read, or still hold */
    SHARE_AHEAD, /* the same, and the bytes that the items under way will probably add */
    SHARE_REPLIES, /* bytes of replies that have not been sent, without results */
    SHARE_FRAMES, /* bytes that are set aside for frames that have not arrived completely */
    SHARE_KINDS
};

/* Zeroed means that nothing is used. */
struct share {
    struct share *parent; /* NULL: the root */
    uint32_t members; /* shares whose parent this is */
    uint64_t used[SHARE_KINDS];
    uint64_t limit[SHARE_KINDS]; /* of the root only */
};

void share_join(struct share *share, struct share *parent);

/* Nothing may be used any more. Does nothing for a share that has not joined. */
void share_leave(struct share *share);

/* Returns what the share's siblings leave of their parent's room. */
uint64_t share_left(const struct share *share, enum share_kind kind);

/* Returns the most that the share may use now. */
uint64_t share_room(const struct share *share, enum share_kind kind);

/*
 * Returns whether the share may use that much more. For items the share's own room decides: its equal part of the queue
 * is open to a newcomer even while others have more than theirs, since a longer queue costs little. What takes memory
 * or descriptors must also fit into every room above.
 */
bool share_fits(const struct share *share, enum share_kind kind, uint64_t amount);

/* Returns whether the share, or one above it, uses more than it has room for. */
bool share_is_over(const struct share *share, enum share_kind kind);

/* Count what a share begins or ceases to use, whether it fits or not. */
void share_take(struct share *share, enum share_kind kind, uint64_t amount);
void share_give(struct share *share, enum share_kind kind, uint64_t amount);

#endif
