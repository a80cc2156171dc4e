/* SPDX-License-Identifier: Apache-2.0 */
/*
 * metrics.h - a second Unix socket, on which monitoring reads the daemon's state: HTTP/1.0, GET /metrics.
 *
 * The socket's mode is 0600: only root and the user whom the daemon runs as can connect, and they learn sums over all
 * clients. What they send is not trusted: a request has METRICS_REQUEST bytes at most, a client METRICS_MS milliseconds
 * for everything, and beyond METRICS_CLIENTS clients at once further ones are turned away. Each connection has one
 * request. Loop thread only.
 */
#ifndef BVHD_METRICS_H
#define BVHD_METRICS_H

#include <uv.h>

#include "daemon/socket/listen.h"
#include "daemon/socket/metrics_request.h"
#include "daemon/system/descriptors.h"
#include "daemon/system/log.h"
#include "proto/base/list.h"
#include "proto/base/memory.h"

enum { METRICS_CLIENTS = 8, METRICS_MS = 5000 };

/* The arguments of a server; the pointers must outlive it. */
struct metrics_options {
    const char *path;
    struct descriptors *descriptors; /* where the clients' sockets are counted */
    struct memory *memory; /* for answers */
    /* Returns the body of an answer, from `memory`, and its size; NULL without memory. */
    char *(*text)(void *context, struct memory *memory, uint64_t *ret_size);
    void *context;
    uint32_t client_ms; /* METRICS_MS, except in tests */
};

/* Zeroed means that it is not open. It must not be moved. */
struct metrics {
    struct metrics_options options;
    uv_loop_t *loop;
    struct listener listener;
    uv_poll_t poll;
    uv_timer_t retry; /* runs while accepting is paused */
    bool open;
    struct list clients;
    struct descriptor_share *share; /* of all clients together */
    uint32_t count; /* of clients */
    struct log_limit refused_log;
};

/* Listens on options->path; the errors are those of listen_bind. */
enum bvhd_status metrics_open(struct metrics *metrics, uv_loop_t *loop, const struct metrics_options *options,
                              struct bvhd_error *error);

/* Closes the socket and all clients, whose memory the loop frees in its next iterations. May be repeated. */
void metrics_close(struct metrics *metrics);

#endif
