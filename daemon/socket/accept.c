/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/accept.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

enum {
    MOST_ACCEPTED = 16, /* clients in one call of accept_waiting */
    RETRY_MS = 100,
    KEPT_DESCRIPTORS = DESCRIPTORS_RESERVE + 16 /* that accepting leaves free */
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

/*
 * Finds out who the client is, and charges the socket to its user, or if that fails, to nobody's share, which serves to
 * refuse the client. A byte that was sent with MSG_OOB becomes one of the stream's: it could not be read
 * otherwise, and the kernel would close descriptors that came with it.
 */
static enum bvhd_status find_peer(struct acceptor *acceptor, int socket, struct session_peer *ret_peer,
                                  struct bvhd_error *error)
{
    struct ucred credentials = {0};
    socklen_t size = sizeof credentials;
    int yes = 1;
    bool known = getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &credentials, &size) == 0 &&
                 setsockopt(socket, SOL_SOCKET, SO_OOBINLINE, &yes, sizeof yes) == 0;
    *ret_peer = (struct session_peer){.uid = credentials.uid, .pid = credentials.pid};
    struct descriptors *descriptors = service_descriptors(acceptor->group->service);
    struct descriptor_share *share = known ? descriptor_share_open(descriptors, credentials.uid) : NULL;
    ret_peer->share =
        share ? share : descriptor_share_open(descriptors, DESCRIPTOR_SHARE_NOBODY); /* which exists already */
    descriptor_share_add(ret_peer->share, 1);
    if (share)
        return BVHD_OK;
    return known ? bvhd_error_no_memory(error, "connection", "no memory for another user")
                 : bvhd_error_set(error, BVHD_IO, "connection", "the client's user cannot be found out");
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

static bool is_nearly(uint32_t used, uint32_t most)
{
    return used >= most - most / 8;
}

/*
 * When room gets short, above seven eighths of a limit, an idle client leaves for each one that comes: one of the same
 * user if it is short of what a user may have, else one of the user with the most connections.
 */
static void make_room(const struct acceptor *acceptor, const struct session_peer *peer)
{
    struct conn_group *group = acceptor->group;
    const struct descriptors *descriptors = service_descriptors(group->service);
    uint32_t most = acceptor->max_connections, left = descriptors_left(descriptors);
    if (is_nearly(conn_group_count_uid(group, peer->uid), most - most / 4))
        conn_group_dismiss_idle(group, peer->uid);
    else if (is_nearly(group->count, most) || left < descriptors->limit / 8)
        conn_group_dismiss_idle(group, CONN_ANY_USER);
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
    if (!descriptor_share_has_room(peer->share, INLET_DESCRIPTORS))
        return bvhd_error_set(error, BVHD_BUSY, "connection",
                              "this user holds %u of the daemon's descriptors, as many as are left for others",
                              atomic_load(&peer->share->used));
    return BVHD_OK;
}

static void take_client(struct acceptor *acceptor, int socket)
{
    struct session_peer peer;
    struct bvhd_error error;
    uint32_t suppressed;
    enum bvhd_status status = find_peer(acceptor, socket, &peer, &error);
    if (status == BVHD_OK) {
        make_room(acceptor, &peer);
        status = check_room(acceptor, &peer, &error);
    }
    if (status == BVHD_OK) {
        if (conn_open(acceptor->group, socket, &peer, &error) == BVHD_OK)
            return;
        service_count_refusal(acceptor->group->service);
        if (log_limit_pass(&acceptor->not_opened_log, &suppressed))
            log_event(LOG_WARNING, "connection_not_opened", "uid=%u pid=%d why=%s suppressed=%u", peer.uid,
                      (int)peer.pid, log_quote(error.text).text, suppressed);
        return;
    }
    service_count_refusal(acceptor->group->service);
    if (log_limit_pass(&acceptor->refused_log, &suppressed))
        log_event(LOG_WARNING, "connection_refused", "uid=%u pid=%d why=%s suppressed=%u", peer.uid, (int)peer.pid,
                  log_quote(error.text).text, suppressed);
    send_refusal(acceptor, socket, &error);
    inlet_close_socket(socket, peer.share);
    descriptor_share_close(peer.share);
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
    acceptor->nobody = descriptor_share_open(service_descriptors(group->service), DESCRIPTOR_SHARE_NOBODY);
    if (!acceptor->nobody)
        return bvhd_error_no_memory(error, "socket", "no memory to accept clients");
    int result = uv_poll_init(group->loop, &acceptor->poll, socket);
    if (result) {
        descriptor_share_close(acceptor->nobody);
        return bvhd_error_set(error, BVHD_IO, "socket", "the event loop does not take it: %s", uv_strerror(result));
    }
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
    descriptor_share_close(acceptor->nobody);
    uv_close((uv_handle_t *)&acceptor->poll, NULL);
    uv_close((uv_handle_t *)&acceptor->retry, NULL);
}
