/* SPDX-License-Identifier: Apache-2.0 */
/*
 * outbox.h - the replies that wait to be written to one client's socket, in order. Loop thread only.
 *
 * A reply's descriptor goes with its frame's first byte. Descriptors that a client has not read yet count against this
 * process's user, so at most OUTBOX_MAX_UNREAD are on their way to one client, and of all clients together half of what
 * the process may have open (descriptors.h). The kernel can be asked how much a client has not read yet, but has no
 * event for it. A socket with a small send buffer comes close: it turns writable when nearly all was read. That is only
 * a hint; whoever waits looks again after a while, too, by flushing.
 */
#ifndef BVHD_OUTBOX_H
#define BVHD_OUTBOX_H

#include "daemon/system/descriptors.h"
#include "daemon/session/reply.h"

enum { OUTBOX_MAX_UNREAD = 4 };

struct outbox {
    int socket; /* non-blocking; the owner's */
    struct descriptors *descriptors;
    void (*left)(void *context, struct reply *reply); /* written or dropped: the reply is its owner's again */
    void *context;
    struct reply *first, **end;
    uint64_t written; /* of the first */
    uint64_t bytes; /* of frames that have not left, with what they hold inline */
    uint32_t replies;
    uint32_t unread; /* descriptors sent since the client was last seen to have read everything */
    int outstanding; /* bytes that the client had not read when it was last looked at, in the kernel's measure */
    int send_buffer; /* the socket's own size while it has a small one; else 0 */
};

/* What keeps the rest from being written. */
enum outbox_state {
    OUTBOX_EMPTY, /* nothing is left */
    OUTBOX_BLOCKED, /* the socket's buffer is full: wait until it is writable */
    OUTBOX_UNREAD, /* this client has to read descriptors first: flush again soon, and when the socket is writable */
    OUTBOX_WAITING, /* for other clients to read descriptors, or for the kernel's memory: flush again soon */
    OUTBOX_LOST, /* nobody reads any more */
};

void outbox_init(struct outbox *outbox, int socket, struct descriptors *descriptors,
                 void (*left)(void *context, struct reply *reply), void *context);

/* Drops all replies and forgets unread descriptors. NULL-safe. */
void outbox_finish(struct outbox *outbox);

void outbox_push(struct outbox *outbox, struct reply *reply);

/* Drops all replies; what is unread stays counted. Nothing may be pushed afterwards: a frame may have been cut off. */
void outbox_drop(struct outbox *outbox);

/* Writes what can be written. *ret_progress: the client has read, or something was written, since the last call. */
enum outbox_state outbox_flush(struct outbox *outbox, bool *ret_progress);

/* Whether descriptors may still lie unread in the client's socket; looks. */
bool outbox_is_unread(struct outbox *outbox);

#endif
