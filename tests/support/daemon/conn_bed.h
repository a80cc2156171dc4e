/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conn_bed.h - connections over socket pairs with fake sessions, and the client's end of each, all in one thread. For
 * unit tests.
 */
#ifndef BVHD_TEST_CONN_BED_H
#define BVHD_TEST_CONN_BED_H

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include "daemon/socket/conn_group.h"
#include "proto/base/container_of.h"
#include "tests/support/daemon/fake_session.h"
#include "tests/support/proto/frames.h"

enum { BED_CLIENTS = 10, BED_PATIENCE_MS = 20000 /* how long a test waits for what has to happen */ };

struct bed_client {
    int socket; /* non-blocking */
    struct frame_parser parser;
    bool eof;
};

struct bed {
    uv_loop_t loop;
    struct fake_service service;
    struct conn_group group;
    struct memory memory; /* the clients' memory */
    struct bed_client clients[BED_CLIENTS];
    int open_before; /* descriptors of the process that were open at the start */
};

static inline void bed_open(struct bed *bed, const struct conn_limits *limits)
{
    struct conn_limits defaults = conn_limits_default();
    memset(bed, 0, sizeof *bed);
    uv_loop_init(&bed->loop); /* the first loop of a process opens descriptors that stay open */
    uv_loop_close(&bed->loop);
    bed->open_before = open_descriptors();
    assert_int_equal(uv_loop_init(&bed->loop), 0);
    fake_service_init(&bed->service);
    memory_init(&bed->memory, UINT64_MAX);
    conn_group_init(&bed->group, &bed->loop, fake_service_face(&bed->service), limits ? limits : &defaults);
    for (int i = 0; i < BED_CLIENTS; i++)
        bed->clients[i].socket = -1;
}

/* The daemon's side of the connection that was opened last. */
static inline struct conn *bed_newest_conn(const struct bed *bed)
{
    return container_of(bed->group.all.first, struct conn, link);
}

/* The size of a connection's send buffer, as the kernel counts it. */
static inline int bed_send_buffer(const struct conn *conn)
{
    int size = 0;
    socklen_t length = sizeof size;
    getsockopt(conn->socket, SOL_SOCKET, SO_SNDBUF, &size, &length);
    return size;
}

/* Opens a connection and returns the client's end. */
static inline struct bed_client *bed_connect(struct bed *bed, uint32_t uid)
{
    int pair[2], i = 0;
    while (bed->clients[i].socket >= 0)
        i++;
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, pair), 0);
    assert_true(descriptors_take(&bed->service.descriptors, 1, 0));
    const struct session_peer peer = {
        .uid = uid, .pid = 1, .share = descriptor_share_open(&bed->service.descriptors, uid)};
    assert_non_null(peer.share);
    descriptor_share_add(peer.share, 1);
    uv_update_time(&bed->loop);
    assert_int_equal(conn_open(&bed->group, pair[0], &peer, NULL), BVHD_OK);
    bed->clients[i] = (struct bed_client){.socket = pair[1]};
    frame_parser_init(&bed->clients[i].parser, &bed->memory, FRAME_MAX_CONTROL, FRAME_MAX_INLINE);
    return &bed->clients[i];
}

static inline uint64_t bed_now(void)
{
    return uv_hrtime() / 1000000;
}

/* Runs an iteration of the event loop: the one with this index of several. The first eight come without a pause. */
static inline void bed_iterate(struct bed *bed, int index)
{
    uv_run(&bed->loop, UV_RUN_NOWAIT);
    if (index >= 8)
        poll(NULL, 0, 1);
}

/*
 * Runs iterations of the event loop for `ms` milliseconds, at least eight. A test that expects something to happen uses
 * bed_await instead, since a busy machine may take longer than any `ms`.
 */
static inline void bed_pump(struct bed *bed, uint64_t ms)
{
    uint64_t end = bed_now() + ms;
    for (int i = 0; i < 8 || bed_now() < end; i++)
        bed_iterate(bed, i);
}

/*
 * Runs iterations of the event loop until the condition, an expression, is true, and fails if that takes longer than
 * BED_PATIENCE_MS. No iteration follows the one that made it true.
 */
#define bed_await(bed, condition)                                                                                      \
    do {                                                                                                               \
        uint64_t bed_end = bed_now() + BED_PATIENCE_MS;                                                                \
        for (int bed_index = 0; !(condition) && bed_now() < bed_end; bed_index++)                                      \
            bed_iterate(bed, bed_index);                                                                               \
        assert_true(condition);                                                                                        \
    } while (0)

static inline bool bed_send_bytes(struct bed_client *client, const void *bytes, size_t size, const int *descriptors,
                                  uint32_t count)
{
    union {
        struct cmsghdr align;
        char bytes[CMSG_SPACE(64 * sizeof(int))];
    } control;
    struct iovec part = {(void *)(uintptr_t)bytes, size};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1};
    if (count) {
        message.msg_control = &control;
        message.msg_controllen = CMSG_SPACE(count * sizeof(int));
        struct cmsghdr *head = CMSG_FIRSTHDR(&message);
        *head = (struct cmsghdr){
            .cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS, .cmsg_len = CMSG_LEN(count * sizeof(int))};
        memcpy(CMSG_DATA(head), descriptors, count * sizeof(int));
    }
    return sendmsg(client->socket, &message, MSG_NOSIGNAL) == (ssize_t)size;
}

static inline bool bed_send(struct bed_client *client, unsigned type, uint64_t request)
{
    unsigned char bytes[FRAME_HEADER_SIZE];
    frame_header_write(&(struct frame_header){.type = (uint16_t)type, .request = request}, bytes);
    return bed_send_bytes(client, bytes, sizeof bytes, NULL, 0);
}

static inline void bed_read(struct bed_client *client)
{
    unsigned char *at;
    uint64_t space;
    int descriptors[4];
    uint32_t count = 0;
    union {
        struct cmsghdr align;
        char bytes[CMSG_SPACE(sizeof descriptors)];
    } control;
    assert_int_equal(frame_parser_space(&client->parser, &at, &space, NULL), BVHD_OK);
    struct iovec part = {at, space};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    ssize_t size = recvmsg(client->socket, &message, MSG_CMSG_CLOEXEC | MSG_DONTWAIT);
    client->eof |= size == 0 || (size < 0 && errno != EAGAIN);
    if (size <= 0)
        return;
    struct cmsghdr *head = CMSG_FIRSTHDR(&message);
    if (head) {
        count = (uint32_t)((head->cmsg_len - CMSG_LEN(0)) / sizeof(int));
        memcpy(descriptors, CMSG_DATA(head), count * sizeof(int));
    }
    assert_int_equal(frame_parser_feed(&client->parser, (uint64_t)size, descriptors, count, NULL), BVHD_OK);
}

/* Receives the next frame within BED_PATIENCE_MS of iterations. Its descriptor belongs to the caller. */
static inline bool bed_receive(struct bed *bed, struct bed_client *client, struct frame *ret_frame)
{
    bool found = false;
    for (uint64_t end = bed_now() + BED_PATIENCE_MS; bed_now() < end;) {
        assert_int_equal(frame_parser_next(&client->parser, ret_frame, &found, NULL), BVHD_OK);
        if (found || client->eof)
            return found;
        bed_read(client);
        bed_pump(bed, 0);
    }
    return false;
}

static inline void bed_expect(struct bed *bed, struct bed_client *client, enum frame_type type, uint64_t request)
{
    struct frame frame;
    assert_true(bed_receive(bed, client, &frame));
    assert_int_equal(frame.header.type, type);
    assert_int_equal(frame.header.request, request);
    for (int i = 0; i < frame.header.descriptors; i++)
        close(frame.descriptors[i]);
}

static inline void bed_hello(struct bed *bed, struct bed_client *client)
{
    assert_true(bed_send(client, FRAME_HELLO, 0));
    bed_expect(bed, client, FRAME_WELCOME, 0);
}

/* Opens a connection that has been greeted. */
static inline struct bed_client *bed_join(struct bed *bed, uint32_t uid)
{
    struct bed_client *client = bed_connect(bed, uid);
    bed_hello(bed, client);
    return client;
}

/* Expects FRAME_ERROR with this status for the connection, then its end. */
static inline void bed_expect_error(struct bed *bed, struct bed_client *client, enum bvhd_status status)
{
    struct frame frame;
    struct bvhd_error *told;
    assert_true(bed_receive(bed, client, &frame));
    assert_int_equal(frame.header.type, FRAME_ERROR);
    assert_int_equal(frame.header.request, 0);
    assert_int_equal(control_unpack_error(frame.control, &bed->memory, &told, NULL), BVHD_OK);
    assert_int_equal(told->status, status);
    memory_free(&bed->memory, told);
    assert_false(bed_receive(bed, client, &frame));
    assert_true(client->eof);
}

static inline void bed_hang_up(struct bed_client *client)
{
    close(client->socket);
    frame_parser_finish(&client->parser);
    client->socket = -1;
}

/* Checks that everything is released. */
static inline void bed_close(struct bed *bed)
{
    for (int i = 0; i < BED_CLIENTS; i++)
        if (bed->clients[i].socket >= 0)
            bed_hang_up(&bed->clients[i]);
    bed_await(bed, bed->group.count == 0);
    conn_group_close(&bed->group);
    conn_group_finish(&bed->group);
    uv_run(&bed->loop, UV_RUN_DEFAULT);
    assert_int_equal(uv_loop_close(&bed->loop), 0);
    assert_int_equal(bed->service.opened, bed->service.closed);
    assert_int_equal(bed->service.connections, 0);
    assert_int_equal(bed->service.memory.live, 0);
    assert_int_equal(bed->memory.live, 0);
    assert_int_equal(bed->service.descriptors.used, 0);
    assert_int_equal(bed->service.descriptors.unread, 0);
    for (uint64_t end = bed_now() + BED_PATIENCE_MS; open_descriptors() != bed->open_before && bed_now() < end;)
        poll(NULL, 0, 1); /* Other threads close some of them. */
    assert_int_equal(open_descriptors(), bed->open_before);
}

#endif
