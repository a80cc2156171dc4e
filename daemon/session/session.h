/* SPDX-License-Identifier: Apache-2.0 */
/*
 * session.h - the protocol with one client: frames in, replies out, no I/O. For the loop thread only.
 *
 * A session belongs to one connection and ends with it. Builds that other clients wait for go on. Every item of an
 * accepted BUILD gets exactly one PREPARED (its payload is not needed any more) and exactly one RESULT.
 */
#ifndef BVHD_SESSION_H
#define BVHD_SESSION_H

#include "proto/wire/frame.h"
#include "daemon/session/peer.h"
#include "daemon/session/reply.h"
#include "daemon/service/service.h"

struct session;

/* How a session reaches its connection. Neither function may call the session. */
struct session_link {
    /* Takes the reply. Replies are sent in this order. */
    void (*send)(void *context, struct reply *reply);
    /*
     * The connection has to end: there was no memory for a reply that the client waits for, or the client does not read
     * its results. The connection sends FRAME_ERROR if it can, then calls session_close, but not from within this call.
     * `fail` may be NULL: then session_frame returns the error at the next frame, as it does in any case.
     */
    void (*fail)(void *context, const struct bvhd_error *error);
    void *context;
    /* Returns how many descriptors the connection itself holds for the client, its socket included. May be NULL. */
    uint32_t (*descriptors)(const void *context);
};

/* Opens a session. `link` is copied; what it points to, and `service`, must outlive the session. BVHD_NO_MEMORY. */
enum bvhd_status session_open(struct service *service, const struct session_peer *peer, const struct session_link *link,
                              struct session **ret_session, struct bvhd_error *error);

/*
 * Handles one frame. The session takes its descriptors; the caller has counted them and charged them to the peer's
 * share, and the session gives both back. Any other result than BVHD_OK means that the client broke the protocol, or
 * with BVHD_NO_MEMORY, that nothing can be answered: the caller sends the error as FRAME_ERROR with request 0, and ends
 * the connection.
 */
enum bvhd_status session_frame(struct session *session, const struct frame *frame, struct bvhd_error *error);

/*
 * Counts a connection that ends because its client broke the protocol, unless `status` is a shortage of memory.
 * session_frame counts what it refuses; the caller counts what breaks before a frame is whole.
 */
void session_count_broken(struct session *session, enum bvhd_status status);

/*
 * Tells the session that a reply was sent or dropped, so that its credits are free again. The connection calls it
 * before reply_destroy, but not after session_close, which frees all credits.
 */
void session_sent(struct session *session, const struct reply *reply);

/*
 * Tells the session that the client has read the descriptors of results that have that many bytes. Results that come
 * inside a frame count as read when they are sent.
 */
void session_read(struct session *session, uint64_t bytes);

/* Cancels the items of requests whose deadline has passed. To be called now and then while there are deadlines. */
void session_check_deadlines(struct session *session, uint64_t now_ns);

/*
 * Returns whether replies that the client leaves unread, with those of its user's other connections, take more than the
 * user's share: nothing more is read from the client until it has read them.
 */
bool session_is_talkative(const struct session *session);

/* Returns whether results that the client has not read or released keep it, or others of its user, from more. */
bool session_is_behind(const struct session *session);

/*
 * Sends PROGRESS of requests whose builds have got on, if the client has asked for it. A client that has not read the
 * last one yet gets no other, so that a slow client is sent little. `now_ms` is a clock of any origin.
 */
void session_report_progress(struct session *session, uint64_t now_ms);

/* Sends GOODBYE, once, with the reason: the daemon drains, or has no room for a client that asks for nothing. */
void session_goodbye(struct session *session, const struct bvhd_error *reason);

/*
 * Returns whether the client would lose nothing with its connection: nothing is under way for it, and it holds no
 * results.
 */
bool session_is_idle(const struct session *session);

/*
 * Tells the session how many bytes the connection sets aside for a frame that has not arrived completely, in place of
 * those that it told last. They count in the client's share, except for FRAME_KEEP bytes or fewer. Returns false, and
 * changes nothing, if they do not fit: nothing is read from the client until they do. A user that has no other such
 * frame can always have one.
 */
bool session_set_frame(struct session *session, uint64_t bytes);

/* Returns how many sessions the client's user has. */
uint32_t session_siblings(const struct session *session);

/* Returns whether HELLO was answered with WELCOME. */
bool session_is_open(const struct session *session);

/*
 * Ends the session, because its connection has ended. All its items are cancelled at once; the session frees itself
 * when no worker has any of them any more. `session` may be NULL.
 */
void session_close(struct session *session);

#endif
