/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conn.h - one client's connection: its socket, what is read and written, its deadlines, its session. Loop thread only.
 *
 * A connection ends when the client hangs up, also by shutting down its writing side alone: its session is closed at
 * once. After a broken protocol the client is told (FRAME_ERROR, request 0), and has a moment to take that. A client
 * that is dropped with descriptors unread keeps its place, without a session, until it lets go of them: the kernel
 * counts them as long.
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
    CONN_ENDING, /* broken: the rest is written, what comes is thrown away */
    CONN_HELD, /* nothing but unread descriptors is left */
    CONN_CLOSED, /* its handles are on their way out */
};

struct conn {
    struct conn_group *group;
    struct list_link link; /* in the group's list of all */
    struct list_link due_link;
    struct list *due_in; /* the group's list that due_link is in; NULL: not due */
    uint64_t cost_ns; /* of its work lately */
    enum conn_state state;
    int socket;
    struct session_peer peer;
    struct session *session; /* NULL once it was closed */
    struct inlet inlet;
    struct outbox outbox;
    uv_poll_t poll;
    uv_timer_t timer;
    unsigned handles; /* open ones */
    int watched; /* events that the poll handle waits for */
    bool lost; /* to be left in this turn */
    bool failed; /* by its session: `failure` says why */
    bool readable, shut;
    bool reading_waits; /* for descriptors or memory */
    bool reading_full; /* too much waits to be written */
    enum outbox_state writing; /* what keeps replies from being written */
    bool writable; /* the loop says so */
    bool hint_failed; /* it said so, and nothing could be written: only time helps */
    struct bvhd_error failure;
    uint32_t pause_ms; /* before the next retry; doubles */
    uint64_t hello_by, read_by, write_by, end_by, retry_at; /* in the loop's milliseconds; 0: none */
};

/*
 * Takes the socket, also when it fails; it is counted (descriptors_take) by the caller, and given back by the
 * connection, then too. Non-blocking, close-on-exec.
 */
enum bvhd_status conn_open(struct conn_group *group, int socket, const struct session_peer *peer,
                           struct bvhd_error *error);

/* The group's: does what is due. The connection may be closed afterwards. */
void conn_work(struct conn *conn);

void conn_goodbye(struct conn *conn);
bool conn_is_flushed(const struct conn *conn);

/* At once, whatever is unread. The struct is freed by the loop. */
void conn_close(struct conn *conn);

#endif
