/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conn_group.h - all connections of a daemon, and what they share: loop, service, limits, turns. Loop thread only.
 *
 * Whatever happens to a connection (bytes, a reply, a deadline) only notes that it is due. What is due is worked off
 * once in each turn of the loop, just before it waits: replies that came together leave together, and nothing is called
 * from within a session's callbacks.
 *
 * Those whose work has taken long lately come after all others, and only as many in one turn as a short time allows:
 * who asks for thousands of things at once, over many connections, waits for himself, and a PING is answered in
 * between.
 */
#ifndef BVHD_CONN_GROUP_H
#define BVHD_CONN_GROUP_H

#include <uv.h>

#include "daemon/socket/conn.h"
#include "daemon/system/log.h"
#include "daemon/service/service.h"

struct conn_limits {
    uint32_t hello_ms; /* from connecting to the answer to HELLO */
    uint32_t stall_ms; /* a client that neither reads what waits for it nor sends the rest of a frame is dropped */
    uint32_t linger_ms; /* after an error, for the client to take it */
    uint32_t held_ms; /* between two looks at whether a client that was dropped has let go of its descriptors */
    uint32_t retry_ms; /* the longest pause before descriptors or memory are asked for again */
    uint32_t turn_bytes, turn_frames; /* that one connection takes in one turn of the loop */
    uint32_t turn_us; /* after which it takes no more frames in that turn */
    uint32_t queue_bytes, queue_replies; /* of unsent replies: beyond it nothing more is read */
};

struct conn_limits conn_limits_default(void);

struct conn_group {
    uv_loop_t *loop;
    struct service *service;
    struct conn_limits limits;
    void (*changed)(void *context); /* a connection came or went, or a turn has ended; may be NULL */
    void *context;
    uv_prepare_t turn;
    uv_idle_t again; /* runs while something is left for the next turn: the loop does not wait */
    struct list all;
    uint32_t count;
    struct conn *working; /* whose work is done now */
    struct list due; /* in this turn */
    struct list costly; /* after those, as time allows */
    struct list later; /* in the next */
    struct log_limit broken_log;
};

/* Starts its turns. `loop` and `service` must outlive it. */
void conn_group_init(struct conn_group *group, uv_loop_t *loop, struct service *service,
                     const struct conn_limits *limits);

/* All connections must be closed. Its handles close with the next turns of the loop. */
void conn_group_finish(struct conn_group *group);

uint32_t conn_group_count_uid(const struct conn_group *group, uint32_t uid);

/* The daemon drains: every session says goodbye; who has no session yet is closed. */
void conn_group_goodbye(struct conn_group *group);

/* Whether every reply has been written. */
bool conn_group_is_flushed(const struct conn_group *group);

/* Closes all, at once. Their handles close with the next turns of the loop. */
void conn_group_close(struct conn_group *group);

/*
 * For conn.c: came and went; due in this turn; due in the next, once its work in this one is done. Repeating is
 * harmless.
 */
void conn_group_add(struct conn_group *group, struct conn *conn);
void conn_group_remove(struct conn_group *group, struct conn *conn);
void conn_group_due(struct conn_group *group, struct conn *conn);
void conn_group_later(struct conn_group *group, struct conn *conn);

#endif
