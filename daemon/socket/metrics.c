/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/metrics.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "daemon/socket/inlet.h"
#include "proto/base/container_of.h"

enum { HEAD_SIZE = 256 };

struct client {
    struct metrics *metrics;
    struct list_link link; /* in metrics->clients */
    int socket;
    uv_poll_t poll;
    uv_timer_t timer;
    unsigned handles; /* of poll and timer, that are not closed yet; the last one frees the struct */
    char request[METRICS_REQUEST];
    size_t received;
    bool answering;
    char head[HEAD_SIZE];
    char *body; /* from options.memory; NULL: none */
    uint64_t head_size, body_size, sent; /* of the answer */
};

static void on_closed(uv_handle_t *handle)
{
    struct client *client = handle->data;
    if (--client->handles == 0)
        free(client);
}

static void close_client(struct client *client)
{
    struct metrics *metrics = client->metrics;
    list_remove(&metrics->clients, &client->link);
    metrics->count--;
    memory_free(metrics->options.memory, client->body);
    uv_close((uv_handle_t *)&client->poll, on_closed);
    uv_close((uv_handle_t *)&client->timer, on_closed);
    inlet_close_socket(client->socket, metrics->share);
}

static void on_timer(uv_timer_t *timer)
{
    close_client(timer->data);
}

/* ---- the answer ---- */

static void make_head(struct client *client, const char *status, const char *type)
{
    int size = snprintf(client->head, sizeof client->head,
                        "HTTP/1.0 %s\r\nContent-Type: %s\r\nContent-Length: %llu\r\nConnection: close\r\n\r\n", status,
                        type, (unsigned long long)client->body_size);
    client->head_size = (uint64_t)size;
    client->answering = true;
}

static void refuse(struct client *client, const char *status)
{
    make_head(client, status, "text/plain");
}

static void answer_text(struct client *client)
{
    const struct metrics_options *options = &client->metrics->options;
    client->body = options->text(options->context, options->memory, &client->body_size);
    if (client->body)
        make_head(client, "200 OK", "text/plain; version=0.0.4; charset=utf-8");
    else
        refuse(client, "503 Service Unavailable");
}

static void answer(struct client *client)
{
    switch (metrics_request_read(client->request, client->received)) {
    case METRICS_FOUND:
        answer_text(client);
        break;
    case METRICS_NOT_FOUND:
        refuse(client, "404 Not Found");
        break;
    case METRICS_NOT_ALLOWED:
        refuse(client, "405 Method Not Allowed");
        break;
    case METRICS_TOO_LONG:
        refuse(client, "431 Request Header Fields Too Large");
        break;
    case METRICS_INCOMPLETE:
        break;
    }
}

/* Sends what the socket takes. Returns false when the client is done, or gone. */
static bool send_answer(struct client *client)
{
    while (client->sent < client->head_size + client->body_size) {
        bool in_head = client->sent < client->head_size;
        const char *from = in_head ? client->head + client->sent : client->body + (client->sent - client->head_size);
        uint64_t left =
            in_head ? client->head_size - client->sent : client->body_size + client->head_size - client->sent;
        ssize_t sent = send(client->socket, from, left, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent < 0 && errno == EINTR)
            continue;
        if (sent < 0)
            return errno == EAGAIN || errno == EWOULDBLOCK;
        client->sent += (uint64_t)sent;
    }
    return false;
}

/* ---- the request ---- */

/* Reads once. Returns false when the client is gone. */
static bool receive(struct client *client)
{
    uint64_t size;
    enum inlet_result result = inlet_read(client->socket, client->metrics->share, client->request + client->received,
                                          METRICS_REQUEST - client->received, &size);
    if (result != INLET_DATA)
        return result == INLET_NOTHING;
    client->received += (size_t)size;
    answer(client);
    return true;
}

static void on_client(uv_poll_t *poll, int status, int events)
{
    struct client *client = poll->data;
    (void)events;
    bool goes_on = status == 0 && (client->answering || receive(client));
    if (goes_on && client->answering)
        goes_on = send_answer(client);
    if (!goes_on)
        close_client(client);
    else if (client->answering)
        uv_poll_start(poll, UV_WRITABLE, on_client);
}

/* ---- the socket ---- */

static void add_client(struct metrics *metrics, int socket)
{
    struct client *client = calloc(1, sizeof *client);
    if (!client || uv_poll_init(metrics->loop, &client->poll, socket)) {
        free(client);
        inlet_close_socket(socket, metrics->share);
        return;
    }
    client->metrics = metrics;
    client->socket = socket;
    client->handles = 2;
    uv_timer_init(metrics->loop, &client->timer);
    client->poll.data = client->timer.data = client;
    list_append(&metrics->clients, &client->link);
    metrics->count++;
    uv_poll_start(&client->poll, UV_READABLE, on_client);
    uv_timer_start(&client->timer, on_timer, metrics->options.client_ms, 0);
}

static void on_listener(uv_poll_t *poll, int status, int events);

static void on_retry(uv_timer_t *timer)
{
    struct metrics *metrics = timer->data;
    uv_poll_start(&metrics->poll, UV_READABLE, on_listener);
}

/* After an error the socket stays readable, and without a pause the loop would spin. */
static void pause_accepting(struct metrics *metrics)
{
    enum { RETRY_MS = 100 };
    uv_poll_stop(&metrics->poll);
    uv_timer_start(&metrics->retry, on_retry, RETRY_MS, 0);
}

/* Returns the socket of the next client, which is counted and charged to the share, or -1. */
static int take_socket(struct metrics *metrics)
{
    if (!descriptors_take(metrics->options.descriptors, 1, DESCRIPTORS_RESERVE)) {
        pause_accepting(metrics);
        return -1;
    }
    int inlined = 1, socket = accept4(metrics->listener.socket, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (socket >= 0) {
        setsockopt(socket, SOL_SOCKET, SO_OOBINLINE, &inlined, sizeof inlined); /* urgent bytes are bytes like others */
        descriptor_share_add(metrics->share, 1);
        return socket;
    }
    descriptors_give(metrics->options.descriptors, 1);
    if (errno != EAGAIN && errno != EWOULDBLOCK)
        pause_accepting(metrics);
    return -1;
}

/* One client for each call, so that nobody keeps the loop; the socket stays readable while more wait. */
static void on_listener(uv_poll_t *poll, int status, int events)
{
    struct metrics *metrics = poll->data;
    uint32_t suppressed;
    (void)status;
    (void)events;
    int socket = take_socket(metrics);
    if (socket < 0)
        return;
    bool has_room = metrics->count < METRICS_CLIENTS && descriptor_share_has_room(metrics->share, 1);
    if (has_room) {
        add_client(metrics, socket);
        return;
    }
    if (log_limit_pass(&metrics->refused_log, &suppressed))
        log_event(LOG_WARNING, "metrics_refused", "clients=%u suppressed=%u", metrics->count, suppressed);
    inlet_close_socket(socket, metrics->share);
}

enum bvhd_status metrics_open(struct metrics *metrics, uv_loop_t *loop, const struct metrics_options *options,
                              struct bvhd_error *error)
{
    *metrics = (struct metrics){.options = *options, .loop = loop};
    struct descriptor_share *share = descriptor_share_open(options->descriptors, DESCRIPTOR_SHARE_METRICS);
    if (!share)
        return bvhd_error_no_memory(error, options->path, "no memory to accept clients");
    enum bvhd_status status = listen_bind(options->path, &metrics->listener, error);
    if (status != BVHD_OK) {
        descriptor_share_close(share);
        return status;
    }
    if (uv_poll_init(loop, &metrics->poll, metrics->listener.socket)) {
        descriptor_share_close(share);
        listen_close(&metrics->listener);
        return bvhd_error_set(error, BVHD_IO, options->path, "the event loop does not take the socket");
    }
    metrics->share = share;
    uv_timer_init(loop, &metrics->retry);
    metrics->poll.data = metrics->retry.data = metrics;
    metrics->open = true;
    uv_poll_start(&metrics->poll, UV_READABLE, on_listener);
    return BVHD_OK;
}

void metrics_close(struct metrics *metrics)
{
    if (!metrics->open)
        return;
    metrics->open = false;
    while (metrics->clients.first)
        close_client(container_of(metrics->clients.first, struct client, link));
    uv_close((uv_handle_t *)&metrics->poll, NULL);
    uv_close((uv_handle_t *)&metrics->retry, NULL);
    listen_close(&metrics->listener);
    descriptor_share_close(metrics->share);
}
