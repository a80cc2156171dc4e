/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/daemon/raw_client.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/fsuid.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

static void fail(const char *what)
{
    perror(what);
    exit(1);
}

static void *allocate(size_t size)
{
    void *block = calloc(1, size ? size : 1);
    if (!block)
        fail("memory");
    return block;
}

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec * 1e3 + (double)time.tv_nsec * 1e-6;
}

bool raw_connect(struct raw_client *client, const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    *client = (struct raw_client){.socket = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)};
    memory_init(&client->memory, UINT64_MAX);
    frame_parser_init(&client->parser, &client->memory, FRAME_MAX_CONTROL, FRAME_MAX_INLINE);
    if (client->socket < 0)
        fail("socket");
    if (connect(client->socket, (struct sockaddr *)&address, sizeof address) == 0)
        return true;
    raw_close(client);
    return false;
}

bool raw_can_be_others(void)
{
    return geteuid() == 0 && setresuid((uid_t)-1, 1, (uid_t)-1) == 0 && setresuid((uid_t)-1, 0, (uid_t)-1) == 0;
}

/* The kernel notes the effective user in connect(), while files are opened as the user of the file system. */
bool raw_connect_as(struct raw_client *client, const char *path, unsigned uid)
{
    uid_t self = geteuid();
    if (setresuid((uid_t)-1, uid, (uid_t)-1) != 0)
        fail("setresuid");
    setfsuid(self);
    bool connected = raw_connect(client, path);
    if (setresuid((uid_t)-1, self, (uid_t)-1) != 0)
        fail("setresuid");
    return connected;
}

void raw_close(struct raw_client *client)
{
    if (client->socket < 0)
        return;
    frame_parser_finish(&client->parser);
    close(client->socket);
    client->socket = -1;
}

/* Sends bytes with their descriptors. Returns -1 when the daemon has closed the connection. */
static ssize_t send_part(int socket, const unsigned char *bytes, size_t size, const int *descriptors, uint32_t count,
                         int flags)
{
    union {
        struct cmsghdr header;
        char space[CMSG_SPACE(RAW_MAX_DESCRIPTORS * sizeof(int))];
    } control;
    struct iovec part = {(void *)(uintptr_t)bytes, size};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1};
    if (count > 0) {
        message.msg_control = &control;
        message.msg_controllen = CMSG_SPACE(count * sizeof(int));
        struct cmsghdr *header = CMSG_FIRSTHDR(&message);
        *header = (struct cmsghdr){
            .cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS, .cmsg_len = CMSG_LEN(count * sizeof(int))};
        memcpy(CMSG_DATA(header), descriptors, count * sizeof(int));
    }
    ssize_t sent;
    do
        sent = sendmsg(socket, &message, flags | MSG_NOSIGNAL);
    while (sent < 0 && errno == EINTR);
    return sent;
}

bool raw_send(struct raw_client *client, const void *bytes, size_t size, const int *descriptors, uint32_t count)
{
    const unsigned char *at = bytes;
    while (size > 0) {
        ssize_t sent = send_part(client->socket, at, size, descriptors, count, 0);
        if (sent < 0)
            return false;
        at += sent;
        size -= (size_t)sent;
        count = 0;
    }
    return true;
}

bool raw_send_urgent(struct raw_client *client, unsigned char byte, const int *descriptors, uint32_t count)
{
    return send_part(client->socket, &byte, 1, descriptors, count, MSG_OOB) == 1;
}

unsigned char *raw_frame_bytes(const struct raw_frame *frame, size_t *ret_size)
{
    struct frame_header header = frame->header;
    header.control_size = (uint32_t)frame->control.size;
    header.inline_size = (uint32_t)frame->inline_bytes.size;
    *ret_size = FRAME_HEADER_SIZE + frame->control.size + frame->inline_bytes.size;
    unsigned char *bytes = allocate(*ret_size);
    frame_header_write(&header, bytes);
    if (frame->control.size)
        memcpy(bytes + FRAME_HEADER_SIZE, frame->control.data, frame->control.size);
    if (frame->inline_bytes.size)
        memcpy(bytes + FRAME_HEADER_SIZE + frame->control.size, frame->inline_bytes.data, frame->inline_bytes.size);
    return bytes;
}

bool raw_send_frame(struct raw_client *client, const struct raw_frame *frame)
{
    size_t size;
    unsigned char *bytes = raw_frame_bytes(frame, &size);
    bool sent = raw_send(client, bytes, size, frame->descriptors, frame->descriptor_count);
    free(bytes);
    return sent;
}

/* Reads once. Returns false when the daemon has closed the connection. */
static bool read_more(struct raw_client *client)
{
    union {
        struct cmsghdr header;
        char space[CMSG_SPACE(64 * sizeof(int))];
    } control;
    struct iovec part;
    uint64_t space;
    unsigned char *at;
    int descriptors[64];
    uint32_t count = 0;
    if (frame_parser_space(&client->parser, &at, &space, NULL) != BVHD_OK)
        fail("the daemon's frames");
    part = (struct iovec){at, space};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    ssize_t size = recvmsg(client->socket, &message, MSG_CMSG_CLOEXEC);
    if (size <= 0)
        return size < 0 && errno == EINTR;
    for (struct cmsghdr *header = CMSG_FIRSTHDR(&message); header; header = CMSG_NXTHDR(&message, header)) {
        if (header->cmsg_level != SOL_SOCKET || header->cmsg_type != SCM_RIGHTS)
            continue;
        uint32_t here = (uint32_t)((header->cmsg_len - CMSG_LEN(0)) / sizeof(int));
        memcpy(descriptors + count, CMSG_DATA(header), here * sizeof(int));
        count += here;
    }
    if (frame_parser_feed(&client->parser, (uint64_t)size, descriptors, count, NULL) != BVHD_OK)
        fail("the daemon's descriptors");
    return true;
}

bool raw_receive(struct raw_client *client, int timeout_ms, struct frame *ret_frame, bool *ret_closed)
{
    double end = now() + timeout_ms;
    if (ret_closed)
        *ret_closed = false;
    for (;;) {
        bool found = false;
        struct bvhd_error error;
        if (frame_parser_next(&client->parser, ret_frame, &found, &error) != BVHD_OK) {
            fprintf(stderr, "the daemon's frames: %s: %s\n", error.where, error.text);
            exit(1);
        }
        if (found)
            return true;
        double left = end - now();
        struct pollfd poller = {.fd = client->socket, .events = POLLIN};
        if (poll(&poller, 1, left > 0 ? (int)left + 1 : 0) == 0)
            return false;
        if (!read_more(client)) {
            if (ret_closed)
                *ret_closed = true;
            return false;
        }
    }
}

static void close_descriptors(const struct frame *frame)
{
    for (int i = 0; i < frame->header.descriptors; i++)
        close(frame->descriptors[i]);
}

bool raw_await(struct raw_client *client, enum frame_type type, int timeout_ms, struct frame *ret_frame)
{
    double end = now() + timeout_ms;
    while (now() < end && raw_receive(client, (int)(end - now()) + 1, ret_frame, NULL)) {
        if (ret_frame->header.type == type)
            return true;
        close_descriptors(ret_frame);
    }
    return false;
}

bool raw_await_close(struct raw_client *client, int timeout_ms, struct bvhd_error *ret_error)
{
    double end = now() + timeout_ms;
    bool closed = false;
    while (!closed && now() < end) {
        struct frame frame;
        if (!raw_receive(client, (int)(end - now()) + 1, &frame, &closed))
            continue;
        close_descriptors(&frame);
        struct bvhd_error *error;
        if (frame.header.type != FRAME_ERROR ||
            control_unpack_error(frame.control, &client->memory, &error, NULL) != BVHD_OK)
            continue;
        if (ret_error)
            *ret_error = *error;
        memory_free(&client->memory, error);
    }
    return closed;
}

bool raw_try_hello(struct raw_client *client)
{
    struct control_hello hello = {
        .version_min = CONTROL_VERSION, .version_max = CONTROL_VERSION, .software = "raw client"};
    struct raw_frame frame = {.header.type = FRAME_HELLO};
    struct frame answer;
    if (control_pack_hello(&hello, &client->memory, &frame.control, NULL) != BVHD_OK)
        fail("hello");
    struct control_welcome *welcome = NULL;
    bool is_welcome = raw_send_frame(client, &frame) && raw_await(client, FRAME_WELCOME, 10000, &answer);
    memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
    if (is_welcome && control_unpack_welcome(answer.control, &client->memory, &welcome, NULL) != BVHD_OK)
        fail("welcome");
    client->builders = is_welcome ? welcome->builders : 0;
    memory_free(&client->memory, welcome);
    return is_welcome;
}

void raw_hello(struct raw_client *client)
{
    if (raw_try_hello(client))
        return;
    fputs("no WELCOME\n", stderr);
    exit(1);
}

struct control_item raw_item(uint64_t payload_offset, uint64_t payload_size, enum control_source source)
{
    return (struct control_item){
        .type = STRUCTURE_BOTTOM,
        .quality = QUALITY_BALANCED,
        .target = TARGET_PORTABLE,
        .geometry_count = 1,
        .geometry_size = ROWS_GEOMETRY_LEAST,
        .reference_size = ROWS_REFERENCE_SIZE,
        .payload_source = source,
        .payload_offset = payload_offset,
        .payload_size = payload_size,
    };
}

unsigned char *raw_payload(uint32_t triangles, uint32_t seed, uint64_t *ret_size)
{
    float *positions = allocate((size_t)triangles * 9 * sizeof *positions);
    for (uint32_t i = 0; i < triangles * 9; i++)
        positions[i] = (float)(i / 9) + (float)((i * 7919u + seed * 104729u) % 1000) / 250.0f;
    struct geometry geometry = {
        .type = GEOMETRY_TRIANGLES,
        .flags = GEOMETRY_OPAQUE,
        .triangles = {.vertex_format = 106, /* R32G32B32_SFLOAT */
                      .max_vertex = triangles * 3 - 1,
                      .vertex_stride = 12,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)positions, (uint64_t)triangles * 36}},
        .range = {.primitive_count = triangles},
    };
    struct build_input input = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &geometry};
    rows_payload_size(&input, ret_size);
    unsigned char *payload = aligned_alloc(64, (*ret_size + 63) / 64 * 64);
    if (!payload)
        fail("memory");
    rows_write(&input, payload);
    free(positions);
    return payload;
}

uint64_t raw_build(struct raw_client *client, const struct control_item *items, uint32_t count,
                   struct bytes inline_bytes, const int *descriptors, const uint64_t *sizes, uint32_t descriptor_count)
{
    struct control_build build = {.priority = client->priority,
                                  .memfd_count = descriptor_count,
                                  .item_count = count,
                                  .items = (struct control_item *)(uintptr_t)items};
    struct raw_frame frame = {
        .header = {.type = FRAME_BUILD, .request = ++client->last_request, .descriptors = (uint8_t)descriptor_count},
        .inline_bytes = inline_bytes,
        .descriptors = descriptors,
        .descriptor_count = descriptor_count,
    };
    for (uint32_t i = 0; i < descriptor_count; i++)
        build.memfd_sizes[i] = sizes[i];
    if (control_pack_build(&build, &client->memory, &frame.control, NULL) != BVHD_OK)
        fail("build");
    bool sent = raw_send_frame(client, &frame);
    memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
    return sent ? client->last_request : 0;
}

void raw_boxes_write(uint32_t count, uint32_t seed, unsigned char payload[RAW_BOXES_PAYLOAD])
{
    struct geometry_row row = {
        .type = GEOMETRY_AABBS, .primitive_count = count, .data = {ROWS_GEOMETRY_LEAST, 6 * sizeof(float)}};
    const float box[6] = {0, 0, 0, 1, 1, 1 + (float)seed};
    memcpy(payload, &row, ROWS_GEOMETRY_LEAST);
    memcpy(payload + ROWS_GEOMETRY_LEAST, box, sizeof box);
}

uint64_t raw_build_boxes(struct raw_client *client, uint32_t count, uint32_t seed, uint64_t size)
{
    unsigned char *payload = allocate(size);
    raw_boxes_write(count, seed, payload);
    struct control_item item = raw_item(0, size, SOURCE_INLINE);
    uint64_t number = raw_build(client, &item, 1, (struct bytes){payload, size}, NULL, NULL, 0);
    free(payload);
    return number;
}

int raw_memfd(const void *bytes, uint64_t size, unsigned seals)
{
    int descriptor = memfd_create("raw", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (descriptor < 0)
        fail("memfd_create");
    for (uint64_t at = 0; at < size;) {
        ssize_t written = write(descriptor, (const unsigned char *)bytes + at, size - at);
        if (written < 0)
            fail("write");
        at += (uint64_t)written;
    }
    if (seals && fcntl(descriptor, F_ADD_SEALS, seals))
        fail("seals");
    return descriptor;
}

struct control_result *raw_result(struct raw_client *client, const struct frame *frame)
{
    struct control_result *result;
    if (frame->header.type != FRAME_RESULT ||
        control_unpack_result(frame->control, &client->memory, &result, NULL) != BVHD_OK)
        return NULL;
    return result;
}
