/* SPDX-License-Identifier: Apache-2.0 */
/* accept.h - takes clients from the listening socket, as many as there is room for. Loop thread only. */
#ifndef BVHD_ACCEPT_H
#define BVHD_ACCEPT_H

#include <uv.h>

#include "daemon/socket/conn_group.h"

struct acceptor {
    struct conn_group *group;
    int socket;
    uint32_t max_connections;
    uv_poll_t poll;
    uv_timer_t retry;
    bool open;
    struct log_limit refused_log, short_log;
};

/*
 * Starts. The socket stays its owner's, and has to outlive the acceptor. With `max_connections` open, or three quarters
 * of them by one user, others are told BUSY. Without descriptors or memory they wait in the socket's queue.
 */
enum bvhd_status accept_open(struct acceptor *acceptor, struct conn_group *group, int socket, uint32_t max_connections,
                             struct bvhd_error *error);

/* Takes those who wait now, at most a few. Returns how many there were. */
unsigned accept_waiting(struct acceptor *acceptor);

/* Stops; its handles close with the next turns of the loop. NULL-safe, harmless when repeated. */
void accept_close(struct acceptor *acceptor);

#endif
