/* SPDX-License-Identifier: Apache-2.0 */
/*
 * raw_client.h - a client that sends exactly what the test tells it, right or wrong: hand-made frames on a daemon's
 * socket.
 *
 * For test programs only: failures on this side are printed to stderr and end the program. The caller judges what the
 * daemon does.
 */
#ifndef BVHD_RAW_CLIENT_H
#define BVHD_RAW_CLIENT_H

#include "proto/wire/control.h"
#include "proto/wire/frame.h"
#include "proto/wire/rows.h"

enum { RAW_MAX_DESCRIPTORS = 253 }; /* of one message: the kernel allows no more */

struct raw_client {
    int socket;
    struct memory memory;
    struct frame_parser parser;
    uint64_t last_request;
    uint32_t builders; /* that WELCOME named, as bits */
    int32_t priority; /* of the builds that raw_build asks for */
};

/* Connects, but does not send HELLO. Returns false when nobody listens or the connection is refused. */
bool raw_connect(struct raw_client *client, const char *path);

/* Returns whether this process may connect as other users: only root may. */
bool raw_can_be_others(void);

/* Connects as another user, as the daemon sees it. The process has to be allowed to. */
bool raw_connect_as(struct raw_client *client, const char *path, unsigned uid);

/* Sends HELLO and receives WELCOME. Ends the program when none comes. */
void raw_hello(struct raw_client *client);

/* The same; returns false when none comes, because the client was refused. */
bool raw_try_hello(struct raw_client *client);

/* Closes everything. It can be called again. */
void raw_close(struct raw_client *client);

/*
 * Sends bytes, with the descriptors on the first byte; blocks. Returns false when the daemon has closed the connection.
 * The descriptors stay open and belong to the caller.
 */
bool raw_send(struct raw_client *client, const void *bytes, size_t size, const int *descriptors, uint32_t count);

/* Sends one byte out of band (MSG_OOB), with descriptors. Returns false on any failure. */
bool raw_send_urgent(struct raw_client *client, unsigned char byte, const int *descriptors, uint32_t count);

/* A frame of any kind. `control` and `inline_bytes` may be empty. */
struct raw_frame {
    struct frame_header header; /* raw_send_frame sets the sizes */
    struct bytes control, inline_bytes;
    const int *descriptors;
    uint32_t descriptor_count; /* number of descriptors sent, whatever the header declares */
};

bool raw_send_frame(struct raw_client *client, const struct raw_frame *frame);

/* Makes the bytes of a frame on the wire; malloc. */
unsigned char *raw_frame_bytes(const struct raw_frame *frame, size_t *ret_size);

/*
 * Receives the next frame within `timeout_ms`; its descriptors belong to the caller. Returns false on a timeout, or
 * when the daemon has closed the connection (*ret_closed, may be NULL).
 */
bool raw_receive(struct raw_client *client, int timeout_ms, struct frame *ret_frame, bool *ret_closed);

/* Receives frames until one of `type` comes. Drops the others and closes their descriptors. */
bool raw_await(struct raw_client *client, enum frame_type type, int timeout_ms, struct frame *ret_frame);

/*
 * Waits until the daemon closes the connection; returns whether it did. Drops the frames before that, but returns the
 * last FRAME_ERROR in *ret_error (may be NULL).
 */
bool raw_await_close(struct raw_client *client, int timeout_ms, struct bvhd_error *ret_error);

/* An item over the mesh of raw_payload, whose payload has `payload_size` bytes. */
struct control_item raw_item(uint64_t payload_offset, uint64_t payload_size, enum control_source source);

/* Makes the payload of a small mesh, a grid of triangles that differs with the seed; malloc. */
unsigned char *raw_payload(uint32_t triangles, uint32_t seed, uint64_t *ret_size);

/* Sends FRAME_BUILD with these items. Returns the request's number, or 0 when the daemon has closed the connection. */
uint64_t raw_build(struct raw_client *client, const struct control_item *items, uint32_t count,
                   struct bytes inline_bytes, const int *descriptors, const uint64_t *sizes, uint32_t descriptor_count);

enum { RAW_BOXES_PAYLOAD = ROWS_GEOMETRY_LEAST + 6 * sizeof(float) };

/* Writes the payload of `count` boxes, which are all the same one: their stride is 0. They differ with the seed. */
void raw_boxes_write(uint32_t count, uint32_t seed, unsigned char payload[RAW_BOXES_PAYLOAD]);

/* Requests them with a payload of `size` bytes inside the frame, RAW_BOXES_PAYLOAD or more. Returns as raw_build. */
uint64_t raw_build_boxes(struct raw_client *client, uint32_t count, uint32_t seed, uint64_t size);

/* Makes a memfd with these bytes and seals. */
int raw_memfd(const void *bytes, uint64_t size, unsigned seals);

/*
 * Unpacks the RESULT in a frame; the caller frees it with memory_free(&client->memory, ...). Returns NULL for another
 * frame.
 */
struct control_result *raw_result(struct raw_client *client, const struct frame *frame);

#endif
