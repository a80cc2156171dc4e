/* SPDX-License-Identifier: Apache-2.0 */
/* session_internal.h - the inside of a session, for the files that it is made of. */
#ifndef BVHD_SESSION_INTERNAL_H
#define BVHD_SESSION_INTERNAL_H

#include "daemon/session/request.h"
#include "daemon/session/session.h"

enum { SESSION_BUCKETS = 64 };

/* Results that have not left. */
struct session_backlog {
    uint64_t bytes;
    bool dropped; /* the service's sum is without them: the session is about to end */
};

struct session {
    struct request_client client;
    struct service *service;
    struct session_peer peer;
    struct session_link link;
    struct session *next, *previous; /* the service's */
    bool open; /* HELLO was answered */
    bool goodbye; /* said */
    bool closed;
    struct bvhd_error failure; /* a reply found no memory */
    struct payload *pool; /* NULL: none */
    uint64_t pool_size;
    uint32_t pool_users; /* items whose payload lies there */
    struct request *requests[SESSION_BUCKETS]; /* by number */
    uint32_t request_count;
    uint32_t under_way; /* items whose result has not left */
    uint32_t attachments; /* memfds of requests under way */
    struct session_backlog backlog;
};

void session_send_busy(struct session *session, uint64_t request);

/* The connection has to go, and the client is told why. */
void session_end(struct session *session, enum bvhd_status status, const char *text);

/*
 * session_backlog.c: results lie in memory that no budget counts. A session with more than its part of the budget on
 * its way, from the start of an item until its result has left, is given nothing more to do until there is less; while
 * results of all sessions together take more than theirs, no session is that has any. When that does not help, since
 * many have a little each, and results beside the cache do fill the budget, the one with most of it has to go. Who
 * comes with new requests while too many results wait is told to come later.
 */
void session_backlog_review(struct session *session); /* what is ahead has changed */
void session_backlog_add(struct session *session, uint64_t bytes);
void session_backlog_take(struct session *session, uint64_t bytes);
void session_backlog_drop(struct session *session);
bool session_backlog_is_long(const struct session *session);

/* The request of that number, or NULL. */
struct request *session_find(const struct session *session, uint64_t number);
void session_add(struct session *session, struct request *request);

/* Whether so many more items can be taken; answers BUSY or an error otherwise. */
bool session_admits(struct session *session, uint64_t request, uint32_t items);

/*
 * A control message that could not be unpacked, but is whole (too large, or of a later version): answers the request
 * with the error. False for anything else, which breaks the protocol.
 */
bool session_refuses(struct session *session, uint64_t request, enum bvhd_status status,
                     const struct bvhd_error *error);

/*
 * session_build.c: FRAME_BUILD. Takes the frame's descriptors. Anything but BVHD_OK breaks the protocol.
 */
enum bvhd_status session_build(struct session *session, const struct frame *frame, struct bvhd_error *error);

/* Closes descriptors of a frame from `first` on, and gives back their counts. */
void session_drop_descriptors(struct session *session, const struct frame *frame, uint32_t first);

#endif
