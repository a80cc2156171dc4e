/* SPDX-License-Identifier: Apache-2.0 */
/*
 * raw_client.h - a client that says exactly what it is told to, right or wrong: frames by hand on a daemon's socket.
 *
 * For test programs only: what cannot be done on this side is said on stderr and ends the program. What the daemon does
 * is for the caller to judge.
 */
#ifndef BVHD_RAW_CLIENT_H
#define BVHD_RAW_CLIENT_H

#include "proto/wire/control.h"
#include "proto/wire/frame.h"
#include "proto/wire/rows.h"

struct raw_client {
    int socket;
    struct memory memory;
    struct frame_parser parser;
    uint64_t last_request;
};

/* Connects, but does not say HELLO. False when nobody listens or the connection is refused. */
bool raw_connect(struct raw_client *client, const char *path);

/* Says HELLO and takes WELCOME; ends the program when there is none. */
void raw_hello(struct raw_client *client);

/* Closes everything. Idempotent. */
void raw_close(struct raw_client *client);

/*
 * Sends bytes, with descriptors on the first one; blocks. False when the daemon has closed. The descriptors stay the
 * caller's.
 */
bool raw_send(struct raw_client *client, const void *bytes, size_t size, const int *descriptors, uint32_t count);

/* A frame of any kind. `control` and `inline_bytes` may be empty. */
struct raw_frame {
    struct frame_header header; /* sizes are set by raw_send_frame */
    struct bytes control, inline_bytes;
    const int *descriptors;
    uint32_t descriptor_count; /* that are sent, whatever the header declares */
};

bool raw_send_frame(struct raw_client *client, const struct raw_frame *frame);

/* The bytes of a frame as they go on the wire; malloc'ed. */
unsigned char *raw_frame_bytes(const struct raw_frame *frame, size_t *ret_size);

/*
 * The next frame, within `timeout_ms`; its descriptors are the caller's. False on a timeout or when the daemon has
 * closed (*ret_closed, may be NULL).
 */
bool raw_receive(struct raw_client *client, int timeout_ms, struct frame *ret_frame, bool *ret_closed);

/* Frames until one of `type` comes; others are dropped, their descriptors closed. */
bool raw_await(struct raw_client *client, enum frame_type type, int timeout_ms, struct frame *ret_frame);

/*
 * Waits until the daemon closes; true if it did. What comes before is dropped, but the last FRAME_ERROR is told
 * (ret_error may be NULL).
 */
bool raw_await_close(struct raw_client *client, int timeout_ms, struct bvhd_error *ret_error);

/* One item over a grid of triangles, in a payload of `payload` bytes: the mesh of raw_payload. */
struct control_item raw_item(uint64_t payload_offset, uint64_t payload_size, enum control_source source);

/* The payload of a small mesh, different for each seed; malloc'ed. */
unsigned char *raw_payload(uint32_t triangles, uint32_t seed, uint64_t *ret_size);

/* FRAME_BUILD with these items; returns the request's number, or 0 when the daemon has closed. */
uint64_t raw_build(struct raw_client *client, const struct control_item *items, uint32_t count,
                   struct bytes inline_bytes, const int *descriptors, const uint64_t *sizes, uint32_t descriptor_count);

/* A memfd with these bytes and seals. */
int raw_memfd(const void *bytes, uint64_t size, unsigned seals);

/* The unpacked RESULT of a frame; freed with memory_free(&client->memory, ...). NULL when it is none. */
struct control_result *raw_result(struct raw_client *client, const struct frame *frame);

#endif
