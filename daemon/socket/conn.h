/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conn.h - one client's connection: its socket, its session, the bytes between both, and its deadlines. Loop thread
 * only.
 *
 * A connection ends when the client hangs up, or shuts down the writing side of its socket: its session is then closed
 * at once. A client that breaks the protocol gets a FRAME_ERROR with request 0, and has conn_limits.linger_ms to read
 * it. A client that is dropped while descriptors are unread in its socket still counts as a connection, without a
 * session, until it has closed its socket or read them: the kernel counts unread descriptors against the daemon's user.
 */
#ifndef BVHD_CONN_H
#define BVHD_CONN_H

#include <uv.h>

#include "daemon/socket/inlet.h"
#include "daemon/socket/outbox.h"
#include "daemon/session/session.h"
#include "proto/base/list.h"

struct conn_group;

enum conn_state {
    CONN_OPEN,
    CONN_ENDING, /* after an error: replies are still written, and input is discarded */
    CONN_HELD, /* the client was dropped, but has not read its descriptors */
    CONN_CLOSED, /* the loop is closing its handles */
};

struct conn {
    struct conn_group *group;
    struct list_link link; /* in group->all */
    struct list_link due_link; /* in *due_in */
    struct list *due_in; /* the list that due_link is in: due, costly or later of the group; NULL: none */
    uint64_t cost_ns; /* how long conn_work has taken lately: a running average */
    enum conn_state state;
    int socket;
    struct session_peer peer;
    struct session *session; /* NULL after it was closed */
    struct inlet inlet;
    struct outbox outbox;
    uv_poll_t poll;
    uv_timer_t timer;
    unsigned handles; /* how many of poll and timer are not closed yet; the last one frees the struct */
    int watched; /* events that the poll handle waits for */
    bool lost; /* the client is gone or was given up; the connection is closed at the end of conn_work */
    bool failed; /* the session cannot go on, for the reason in `failure` */
    bool readable; /* the socket has something to read, as far as is known */
    bool is_large; /* the socket has a larger send buffer */
    bool write_shut; /* the socket's writing side was shut down */
    bool reading_waits; /* nothing is read until descriptors or memory are free */
    bool reading_full; /* nothing is read until replies were written */
    enum outbox_state writing; /* what keeps replies from being written */
    bool writable; /* the loop has reported the socket as writable since the last flush */
    /* the loop reported the socket as writable, but a flush made no progress: only the timer leads to the next flush */
    bool hint_failed;
    struct bvhd_error failure;
    uint64_t active_at; /* uv_now() when something was last read or written */
    uint32_t pause_ms; /* before the next retry; doubles with each */
    /* deadlines in milliseconds of uv_now(); 0: none */
    uint64_t hello_by, read_by, frame_by, write_by, leave_by, end_by, retry_at;
    uint64_t frame_begin; /* what frame_by is for: where the unfinished frame begins in the client's stream */
};

/*
 * Opens a connection with a session. `socket` is non-blocking and close-on-exec, and the caller has counted it
 * (descriptors_take) and charged it to peer->share, which is open. The connection takes over both, and gives them back;
 * this is also true when the call fails.
 */
enum bvhd_status conn_open(struct conn_group *group, int socket, const struct session_peer *peer,
                           struct bvhd_error *error);

/* The following are for the group. */

/* Reads, handles frames, writes and checks deadlines, as far as it is possible now. It may close the connection. */
void conn_work(struct conn *conn);

/* The daemon drains: the client gets GOODBYE if it has said HELLO, else the connection is closed. */
void conn_goodbye(struct conn *conn, const struct bvhd_error *reason);

/*
 * Returns since when the client has asked for nothing and holds nothing, as a time of uv_now(); UINT64_MAX if that is
 * not so, or if it has been told to leave.
 */
uint64_t conn_idle_since(const struct conn *conn);

/*
 * An idle client gets GOODBYE, because there is no room for it, and conn_limits.linger_ms to leave by itself. Requests
 * that it has sent until then are still answered.
 */
void conn_dismiss(struct conn *conn);

/* Returns whether all replies have been written. */
bool conn_is_flushed(const struct conn *conn);

/* Closes the connection at once, even if replies or descriptors are unread. The loop frees the struct later. */
void conn_close(struct conn *conn);

#endif
