/* SPDX-License-Identifier: Apache-2.0 */
/*
 * session.h - the protocol with one client: frames in, replies out, no I/O. Loop thread only.
 *
 * A session belongs to one connection and ends with it; the builds that others wait for too go on. Every item of a
 * BUILD that was taken gets exactly one PREPARED (its payload is not needed any more) and exactly one RESULT.
 */
#ifndef BVHD_SESSION_H
#define BVHD_SESSION_H

#include "proto/wire/frame.h"
#include "daemon/session/reply.h"
#include "daemon/service/service.h"

struct session;

/* How a session reaches its connection. Neither may call back into the session. */
struct session_link {
    void (*send)(void *context, struct reply *reply); /* takes the reply; queued, sent in order */
    /*
     * There was no memory for a reply that the client waits for, so the connection has to end: FRAME_ERROR if possible,
     * then session_close, not from within this call. NULL: session_frame says it at the next frame.
     */
    void (*fail)(void *context, const struct bvhd_error *error);
    void *context;
};

/* Who the client is, for log lines. */
struct session_peer {
    uint32_t uid;
    int32_t pid;
};

enum bvhd_status session_open(struct service *service, const struct session_peer *peer, const struct session_link *link,
                              struct session **ret_session, struct bvhd_error *error);

/*
 * One frame. Its descriptors belong to the session from here on; they are counted (descriptors_take) by the caller and
 * given back by the session. Anything but BVHD_OK is a broken protocol, or BVHD_NO_MEMORY where nothing can be
 * answered: the caller sends the error as FRAME_ERROR with request 0 and ends the connection.
 */
enum bvhd_status session_frame(struct session *session, const struct frame *frame, struct bvhd_error *error);

/*
 * A reply has left, or was dropped: its credits are free again. Before reply_destroy; not after session_close, which
 * frees all of them.
 */
void session_sent(struct session *session, const struct reply *reply);

/* The daemon drains: tells the client once, by GOODBYE. */
void session_goodbye(struct session *session);

/* HELLO was answered with WELCOME. */
bool session_is_open(const struct session *session);

/*
 * The client is gone: its items lose their interest at once; the session frees itself when the last worker lets go of
 * it. NULL-safe.
 */
void session_close(struct session *session);

#endif
