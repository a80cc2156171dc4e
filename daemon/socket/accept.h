/* SPDX-License-Identifier: Apache-2.0 */
/* accept.h - accepts clients from the listening socket and opens a connection for each. Loop thread only. */
#ifndef BVHD_ACCEPT_H
#define BVHD_ACCEPT_H

#include <uv.h>

#include "daemon/socket/conn_group.h"

struct acceptor {
    struct conn_group *group;
    int socket; /* the listening one; it belongs to the caller of accept_open */
    uint32_t max_connections;
    struct descriptor_share *nobody; /* for clients that are refused because nothing is known of their user */
    uv_poll_t poll;
    uv_timer_t retry; /* runs while accepting is paused */
    bool open;
    /* for log lines about clients that were refused, and about a shortage of descriptors or memory */
    struct log_limit refused_log, not_opened_log, short_log;
};

/*
 * Starts to accept clients. The caller keeps the socket, which has to outlive the acceptor. While `max_connections` are
 * open, or three quarters of them by one user, or this user holds its share of descriptors (descriptor_share.h),
 * further clients (or further clients of this user) get the error BUSY and are closed. While descriptors or memory are
 * short, clients wait in the socket's queue. Fails with BVHD_IO, and with BVHD_NO_MEMORY.
 */
enum bvhd_status accept_open(struct acceptor *acceptor, struct conn_group *group, int socket, uint32_t max_connections,
                             struct bvhd_error *error);

/* Accepts the clients that wait now, at most a few. Returns how many it has accepted or refused. */
unsigned accept_waiting(struct acceptor *acceptor);

/*
 * Stops accepting. The loop closes the acceptor's handles in its next iterations. `acceptor` may be NULL; the call may
 * be repeated.
 */
void accept_close(struct acceptor *acceptor);

#endif
