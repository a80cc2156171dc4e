/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conn_group.h - all connections of a daemon, and what they share: the loop, the service, limits, and the time of each
 * loop iteration. Loop thread only.
 *
 * An event for a connection (bytes, a reply, a deadline) only marks it as due. In each iteration of the loop, just
 * before it waits, conn_work is called once for every connection that is due, except for costly ones (see below). So
 * replies that were made together are written together, and a session is never called from within one of its own
 * callbacks.
 *
 * Connections whose work has taken long lately are costly. They are served after all others, and only for a short time
 * in each iteration. So a client that makes thousands of requests at once, over many connections, delays only itself,
 * and other clients' frames, such as PING, are answered in between.
 */
#ifndef BVHD_CONN_GROUP_H
#define BVHD_CONN_GROUP_H

#include <uv.h>

#include "daemon/socket/conn.h"
#include "daemon/system/log.h"
#include "daemon/service/service.h"

struct conn_limits {
    uint32_t hello_ms; /* from connecting until HELLO is answered */
    uint32_t stall_ms; /* how long a client may leave replies unread, or a frame incomplete, without any progress */
    uint32_t frame_ms; /* how long a frame may take to arrive, however it progresses */
    uint32_t linger_ms; /* how long a client has to read an error */
    /* the longest pause between two checks whether a client has read its descriptors, or, once dropped, closed them */
    uint32_t held_ms;
    uint32_t idle_ms; /* how long a client has asked for nothing before it may be told to make room */
    uint32_t retry_ms; /* the longest pause before descriptors or memory are requested again */
    uint32_t share_bytes, share_frames; /* that are taken from one connection in one iteration of the loop */
    uint32_t share_us; /* time in an iteration after which a connection's next frame is put off */
    uint32_t large_from, large_most; /* bytes sent from which sockets get a larger send buffer; how many have it */
    uint32_t queue_bytes, queue_replies; /* unsent replies of a connection; beyond them nothing more is read from it */
};

struct conn_limits conn_limits_default(void);

struct conn_group {
    uv_loop_t *loop;
    struct service *service;
    struct conn_limits limits;
    /* called in each iteration, after the connections were served, to check whether the daemon may end; may be NULL */
    void (*changed)(void *context);
    void *context;
    uv_prepare_t prepare; /* does the work, just before the loop waits */
    uv_timer_t progress; /* runs while something is built or has a deadline, for the sessions */
    uv_idle_t again; /* runs while work is left for the next iteration, so that the loop does not wait */
    struct list all;
    uint32_t count; /* of connections in `all` */
    uint32_t large; /* of those with a larger send buffer */
    uint64_t opened; /* connections so far: the number of the newest */
    struct conn *working; /* the connection in conn_work now, else NULL */
    struct list due; /* for this iteration */
    struct list costly; /* for this iteration after `due`, and the next ones, as time allows */
    struct list later; /* for the next iteration */
    struct log_limit broken_log, stalled_log, idle_log; /* for log lines about clients that are dropped */
};

/* Starts the group, without connections. `loop` and `service` must outlive it. */
void conn_group_init(struct conn_group *group, uv_loop_t *loop, struct service *service,
                     const struct conn_limits *limits);

/* Ends the group. All connections must be closed. The loop closes the group's handles in its next iterations. */
void conn_group_finish(struct conn_group *group);

/* Returns how many connections the user with this uid has. */
uint32_t conn_group_count_uid(const struct conn_group *group, uint32_t uid);

/*
 * Room is short: tells the client to leave (conn_dismiss) that has been idle longest among those of the user with the
 * most connections that has an idle one, or of the one user `uid`. Clients that have been idle for less than
 * conn_limits.idle_ms stay. Returns whether there was one.
 */
#define CONN_ANY_USER UINT32_MAX
bool conn_group_dismiss_idle(struct conn_group *group, uint32_t uid);

/* The daemon drains: each client that has said HELLO gets GOODBYE; the connections of others are closed. */
void conn_group_goodbye(struct conn_group *group);

/* Returns whether every reply has been written. */
bool conn_group_is_flushed(const struct conn_group *group);

/* Closes all connections at once. The loop closes their handles and frees them in its next iterations. */
void conn_group_close(struct conn_group *group);

/* The following are for conn.c. */

/* Adds a new connection, and removes one that is closed. */
void conn_group_add(struct conn_group *group, struct conn *conn);
void conn_group_remove(struct conn_group *group, struct conn *conn);

/* Marks a connection as due in this iteration. The call may be repeated. */
void conn_group_due(struct conn_group *group, struct conn *conn);

/* Called from conn_work: marks the connection as due in the next iteration. The call may be repeated. */
void conn_group_later(struct conn_group *group, struct conn *conn);

#endif
