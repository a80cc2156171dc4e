/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reply.h - one frame on its way to a client. The session makes it and hands it to the connection, which sends or drops
 * it, reports that by session_sent, and then destroys it. For the loop thread only.
 */
#ifndef BVHD_REPLY_H
#define BVHD_REPLY_H

#include "daemon/service/blob.h"
#include "proto/wire/control.h"
#include "proto/wire/frame.h"

struct reply {
    struct reply *next; /* the link of the queue that the reply is in (outbox.h) */
    struct frame_header header; /* all fields are set */
    struct bytes control; /* owned, from `memory` */
    struct memory *memory;
    /*
     * NULL: none; else the reply holds a reference. Small blobs are sent inside the frame, others by their descriptor
     */
    struct blob *blob;
    /*
     * how many items this reply ends: the client may have that many more under way once the reply was sent or dropped
     */
    uint32_t credits;
};

/*
 * Makes a frame without a blob. It takes over `control`, which must be from `memory`, and frees it on failure. Returns
 * NULL without memory.
 */
struct reply *reply_create(enum frame_type type, uint64_t request, struct bytes control, struct memory *memory);

/* Makes a RESULT, with a reference to `blob` unless that is NULL. Returns NULL without memory. */
struct reply *reply_result(uint64_t request, const struct control_result *result, struct blob *blob,
                           struct memory *memory);
/* Makes an ERROR. Returns NULL without memory. */
struct reply *reply_error(uint64_t request, const struct bvhd_error *error, struct memory *memory);

/* The bytes of a reply in memory, without a result. */
static inline uint64_t reply_size(const struct reply *reply)
{
    return sizeof *reply + reply->header.control_size;
}

/* Frees the frame and drops its reference to the blob. `reply` may be NULL. */
void reply_destroy(struct reply *reply);

#endif
