/* SPDX-License-Identifier: Apache-2.0 */
/*
 * outbox.h - the queue of replies that are to be written to one client's socket, in order. Loop thread only.
 *
 * A reply's descriptor is sent with the first byte of its frame. The kernel counts descriptors that a client has not
 * read yet against the daemon's user. So at most OUTBOX_MAX_UNREAD are unread by one client, by the clients of one user
 * at most as many as are left for others (descriptor_share.h), and by all clients together at most half of those that
 * the process is allowed to open (descriptors.h).
 *
 * The kernel tells on request how much a client has not read yet, but it has no event for it. A socket with a small
 * send buffer is nearly as good: it becomes writable when almost everything was read. This is only a hint, so a caller
 * that waits for a client to read has to flush again after a while, too.
 */
#ifndef BVHD_OUTBOX_H
#define BVHD_OUTBOX_H

#include "daemon/system/descriptor_share.h"
#include "daemon/session/reply.h"

enum { OUTBOX_MAX_UNREAD = 4 };

/* How an outbox reports. */
struct outbox_events {
    void (*done)(void *context, struct reply *reply); /* a reply was written or dropped; the callee now owns it */
    void (*read)(void *context, uint64_t bytes); /* the client has read the descriptor of a result of that size */
};

struct outbox {
    int socket; /* non-blocking; it belongs to the caller of outbox_init */
    struct descriptor_share *share; /* where unread descriptors are counted */
    struct outbox_events events;
    void *context;
    struct reply *first, **end;
    uint64_t written; /* bytes of the first reply's frame */
    uint64_t bytes; /* of all frames in the queue, with their inline bytes */
    uint32_t replies; /* in the queue */
    uint32_t unread; /* descriptors sent that the client may not have read: an upper bound */
    uint64_t unread_sizes[OUTBOX_MAX_UNREAD]; /* the bytes behind them, oldest first */
    int outstanding; /* what the client had not read at the last check, in bytes as the kernel counts them */
    uint64_t sent; /* bytes that the socket has taken so far */
    int send_buffer; /* the size of the socket's send buffer before it was made small; 0: it was not */
};

/* Why replies are left after a flush. */
enum outbox_state {
    OUTBOX_EMPTY, /* none are left */
    OUTBOX_BLOCKED, /* the socket's buffer is full: flush when it is writable */
    OUTBOX_UNREAD, /* this client has to read descriptors first: flush again soon, and when the socket is writable */
    OUTBOX_WAITING, /* other clients have to read descriptors first, or the kernel lacks memory: flush again soon */
    OUTBOX_LOST, /* the client is gone */
};

/* Makes an empty queue. `socket` and `share` have to outlive it. */
void outbox_init(struct outbox *outbox, int socket, struct descriptor_share *share, const struct outbox_events *events,
                 void *context);

/* Drops all replies, and no longer counts unread descriptors. `outbox` may be NULL. */
void outbox_finish(struct outbox *outbox);

/* Appends a reply, which belongs to the outbox until done() is called. Nothing is written yet. */
void outbox_push(struct outbox *outbox, struct reply *reply);

/*
 * Drops all replies; unread descriptors stay counted. Nothing may be pushed afterwards, since a frame may have been
 * written in part.
 */
void outbox_drop(struct outbox *outbox);

/* Writes as much as possible. *ret_progress: something was written, or the client has read since the last call. */
enum outbox_state outbox_flush(struct outbox *outbox, bool *ret_progress);

/*
 * Gives the socket a larger send buffer, as far as the system allows. The kernel's default is full after three results
 * of 60 KiB, and then the loop and a client that reads many results wait until one has woken the other, again and
 * again.
 */
void outbox_make_large(struct outbox *outbox);

/* Checks with the kernel, and returns whether descriptors may still be unread in the client's socket. */
bool outbox_is_unread(struct outbox *outbox);

#endif
