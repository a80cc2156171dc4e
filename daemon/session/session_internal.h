/* SPDX-License-Identifier: Apache-2.0 */
/*
 * session_internal.h - the inside of a session, for the files that it is made of.
 *
 * session.c: opening, closing, replies, requests by number, quotas. session_frames.c: one function for each type of
 * frame. session_build.c: FRAME_BUILD. session_cache.c: FRAME_CACHE. session_clients.c: FRAME_CLIENTS.
 * session_backlog.c: results that the client has not read. session_progress.c: how far builds are.
 */
#ifndef BVHD_SESSION_INTERNAL_H
#define BVHD_SESSION_INTERNAL_H

#include "daemon/session/request.h"
#include "daemon/session/session.h"

enum { SESSION_BUCKETS = 64 };

struct session {
    struct request_client client;
    struct service *service;
    struct session_peer peer;
    struct session_link link;
    uint64_t opened_ns;
    char software[CONTROL_NAME_SIZE]; /* as in HELLO; "" before it */
    struct list_link in_service; /* in the list of all sessions */
    bool open; /* HELLO was answered with WELCOME */
    bool goodbye; /* GOODBYE was sent */
    bool closed;
    struct bvhd_error failure; /* why the connection has to end; BVHD_OK: it does not */
    struct payload *pool; /* the client's shared memory; NULL: none */
    uint32_t pool_users; /* items whose payload lies in the pool and is still needed */
    struct request *requests[SESSION_BUCKETS]; /* a hash table by request number, linked by request->next */
    uint32_t request_count;
    struct cache_task *cache_task; /* the trim or clear of the cache that it waits for; NULL: none */
    uint32_t progress_ms; /* the shortest time between two reports of progress; 0: the client wants none */
    uint64_t progress_at; /* when the last one was made */
    uint32_t progress_unsent; /* PROGRESS frames that have not been sent or dropped */
    bool releases; /* the client says when it does not hold results any more */
    uint64_t held; /* bytes of results that were sent in descriptors to a client that releases, and are not released */
    uint32_t with_deadline; /* requests that have one */
};

/* Returns what the session uses of its share: for SHARE_ITEMS, the credits that are in use. */
static inline uint64_t session_uses(const struct session *session, enum share_kind kind)
{
    return session->client.member.share.used[kind];
}

/* Returns the account that messages and replies are allocated from. */
static inline struct memory *session_memory(const struct session *session)
{
    return service_frame_memory(session->service);
}

/* ---- replies ---- */

/* Sends a reply; NULL means that there was no memory for it, which ends the connection. */
void session_send(struct session *session, struct reply *reply);

/* Sends a frame without a control message. */
void session_send_plain(struct session *session, enum frame_type type, uint64_t request);

/* Answers a request with ERROR, and counts it. */
void session_send_error(struct session *session, uint64_t request, const struct bvhd_error *error);

/* Answers a request with BUSY, and counts it. `why` is for the log. */
void session_send_busy(struct session *session, uint64_t request, const char *why);

/* Ends the connection, and tells the client why. Only the first call has an effect. */
void session_end(struct session *session, enum bvhd_status status, const char *text);

/* Ends the connection because there is no memory for a reply. */
void session_fail(struct session *session);

/* ---- requests ---- */

/* Returns the request of that number, or NULL. */
struct request *session_find(const struct session *session, uint64_t number);

void session_add(struct session *session, struct request *request);

/* Checks whether `items` more items can be taken. If not, answers the request with BUSY or ERROR and returns false. */
bool session_admits(struct session *session, uint64_t request, uint32_t items);

/* ---- frames ---- */

/*
 * Decides what follows when a request's control message cannot be unpacked, with `status`. If it is only too large or
 * of a later version, the function answers the request with the error and returns true: the session goes on. For any
 * other status it returns false: the client broke the protocol.
 */
bool session_refuses(struct session *session, uint64_t request, enum bvhd_status status,
                     const struct bvhd_error *error);

/* Closes a frame's descriptors, except the first `first` of them, and gives back their counts. */
void session_drop_descriptors(struct session *session, const struct frame *frame, uint32_t first);

/* Handles FRAME_BUILD, and takes the frame's descriptors. Any other result than BVHD_OK breaks the protocol. */
enum bvhd_status session_build(struct session *session, const struct frame *frame, struct bvhd_error *error);

/* Handles FRAME_CLIENTS. Any other result than BVHD_OK breaks the protocol. */
enum bvhd_status session_list_clients(struct session *session, const struct frame *frame, struct bvhd_error *error);

/* Handles FRAME_CACHE. Any other result than BVHD_OK breaks the protocol. */
enum bvhd_status session_cache(struct session *session, const struct frame *frame, struct bvhd_error *error);

/* Forgets the trim or clear that the session waits for: it goes on, and is not answered. */
void session_cache_leave(struct session *session);

/*
 * ---- backpressure ----
 *
 * Results that clients have not read are in memory that no budget counts, so a session must not get far ahead of its
 * client. All sessions together may be ahead by half of the budget: by results that clients have not read or still
 * hold, and by what the items that have started will probably add. Users and their connections have shares of that
 * (share.h). While a session or its user is ahead by more than its share, none of its items starts (user.h). While the
 * results alone exceed the share, its new requests are answered with BUSY.
 */

/* Count a result when its reply is made, and when the client has read it. `bytes` is the blob's size. */
void session_add_result(struct session *session, uint64_t bytes);
void session_take_result(struct session *session, uint64_t bytes);

/* FRAME_RELEASED. Fails with BVHD_INVALID if the client does not hold as much. */
enum bvhd_status session_release(struct session *session, uint64_t bytes, struct bvhd_error *error);

#endif
