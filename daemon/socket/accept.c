/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/accept.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

#include "daemon/system/release.h"

enum {
    MOST_ACCEPTED = 16, /* clients in one call of accept_waiting */
    RETRY_MS = 100,
    KEPT_DESCRIPTORS = 2 * DESCRIPTORS_RESERVE /* that accepting leaves free */
};

static void on_poll(uv_poll_t *poll, int status, int events);

static void on_retry(uv_timer_t *timer)
{
    struct acceptor *acceptor = timer->data;
    uv_poll_start(&acceptor->poll, UV_READABLE, on_poll);
}

/*
 * Stops accepting for RETRY_MS. The socket stays readable while clients wait, so without a pause the loop would spin.
 */
static void pause_accepting(struct acceptor *acceptor, const char *why)
{
    uint32_t suppressed;
    if (log_limit_pass(&acceptor->short_log, &suppressed))
        log_event(LOG_WARNING, "accept_paused", "why=%s suppressed=%u", log_quote(why).text, suppressed);
    uv_poll_stop(&acceptor->poll);
    uv_timer_start(&acceptor->retry, on_retry, RETRY_MS, 0);
}

static bool find_peer(int socket, struct session_peer *ret_peer)
{
    struct ucred credentials;
    socklen_t size = sizeof credentials;
    if (getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &credentials, &size))
        return false;
    *ret_peer = (struct session_peer){.uid = credentials.uid, .pid = credentials.pid};
    return true;
}

/*
 * Sends the error with one write. The buffer of a new socket has room for it, so the write fails only if the client is
 * gone.
 */
static void send_refusal(struct acceptor *acceptor, int socket, const struct bvhd_error *error)
{
    struct reply *reply = reply_error(0, error, service_frame_memory(acceptor->group->service));
    if (!reply)
        return;
    unsigned char bytes[FRAME_HEADER_SIZE + 1024];
    frame_header_write(&reply->header, bytes);
    if (reply->header.control_size <= sizeof bytes - FRAME_HEADER_SIZE) {
        memcpy(bytes + FRAME_HEADER_SIZE, reply->control.data, reply->header.control_size);
        send(socket, bytes, FRAME_HEADER_SIZE + reply->header.control_size, MSG_NOSIGNAL | MSG_DONTWAIT);
    }
    reply_destroy(reply);
}

static enum bvhd_status check_room(const struct acceptor *acceptor, const struct session_peer *peer,
                                   struct bvhd_error *error)
{
    uint32_t most = acceptor->max_connections, share = most - most / 4;
    if (acceptor->group->count >= most)
        return bvhd_error_set(error, BVHD_BUSY, "connection", "%u connections are open, the most allowed", most);
    if (conn_group_count_uid(acceptor->group, peer->uid) >= share)
        return bvhd_error_set(error, BVHD_BUSY, "connection", "this user has %u connections open, the most allowed",
                              share);
    return BVHD_OK;
}

static void take_client(struct acceptor *acceptor, int socket)
{
    struct session_peer peer;
    struct bvhd_error error;
    struct descriptors *descriptors = service_descriptors(acceptor->group->service);
    enum bvhd_status status = find_peer(socket, &peer) ? check_room(acceptor, &peer, &error)
                                                       : bvhd_error_set(&error, BVHD_IO, "connection",
                                                                        "the client's user cannot be found out");
    if (status == BVHD_OK) {
        if (conn_open(acceptor->group, socket, &peer, &error) != BVHD_OK)
            log_event(LOG_WARNING, "connection_not_opened", "why=%s", log_quote(error.text).text);
        return;
    }
    uint32_t suppressed;
    if (log_limit_pass(&acceptor->refused_log, &suppressed))
        log_event(LOG_WARNING, "connection_refused", "why=%s suppressed=%u", log_quote(error.text).text, suppressed);
    send_refusal(acceptor, socket, &error);
    release_descriptor(socket);
    descriptors_give(descriptors, 1);
}

/* Returns the socket of the next client, or -1 when no client waits or accepting had to be paused. */
static int take_socket(struct acceptor *acceptor)
{
    struct descriptors *descriptors = service_descriptors(acceptor->group->service);
    if (!descriptors_take(descriptors, 1, KEPT_DESCRIPTORS)) {
        pause_accepting(acceptor, "no file descriptors are left");
        return -1;
    }
    int socket;
    do
        socket = accept4(acceptor->socket, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
    while (socket < 0 && (errno == EINTR || errno == ECONNABORTED));
    if (socket >= 0)
        return socket;
    if (errno != EAGAIN && errno != EWOULDBLOCK)
        pause_accepting(acceptor, strerror(errno));
    descriptors_give(descriptors, 1);
    return -1;
}

unsigned accept_waiting(struct acceptor *acceptor)
{
    unsigned count = 0;
    for (int socket; count < MOST_ACCEPTED && (socket = take_socket(acceptor)) >= 0; count++)
        take_client(acceptor, socket);
    return count;
}

static void on_poll(uv_poll_t *poll, int status, int events)
{
    struct acceptor *acceptor = poll->data;
    (void)events;
    if (status < 0)
        pause_accepting(acceptor, uv_strerror(status));
    else
        accept_waiting(acceptor);
}

enum bvhd_status accept_open(struct acceptor *acceptor, struct conn_group *group, int socket, uint32_t max_connections,
                             struct bvhd_error *error)
{
    *acceptor = (struct acceptor){.group = group, .socket = socket, .max_connections = max_connections};
    int result = uv_poll_init(group->loop, &acceptor->poll, socket);
    if (result)
        return bvhd_error_set(error, BVHD_IO, "socket", "the event loop does not take it: %s", uv_strerror(result));
    uv_timer_init(group->loop, &acceptor->retry);
    acceptor->poll.data = acceptor->retry.data = acceptor;
    acceptor->open = true;
    uv_poll_start(&acceptor->poll, UV_READABLE, on_poll);
    return BVHD_OK;
}

void accept_close(struct acceptor *acceptor)
{
    if (!acceptor || !acceptor->open)
        return;
    acceptor->open = false;
    uv_close((uv_handle_t *)&acceptor->poll, NULL);
    uv_close((uv_handle_t *)&acceptor->retry, NULL);
}
