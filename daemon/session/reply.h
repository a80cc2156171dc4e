/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reply.h - one frame on its way to a client. The session makes it and hands it to the connection, which sends or drops
 * it, and then destroys it. For the loop thread only.
 */
#ifndef BVHD_REPLY_H
#define BVHD_REPLY_H

#include "daemon/service/blob.h"
#include "proto/wire/control.h"
#include "proto/wire/frame.h"

struct reply {
    struct reply *next; /* belongs to the holder */
    struct frame_header header; /* complete */
    struct bytes control; /* owned, from `memory` */
    struct memory *memory;
    struct blob *blob; /* a ref, or NULL; its bytes follow inline, or its descriptor goes with the frame */
    uint32_t credits; /* items that this reply ends; the client has these credits again once it has left */
};

/* Makes a frame without a blob. Takes `control`, also when it fails. NULL without memory. */
struct reply *reply_create(enum frame_type type, uint64_t request, struct bytes control, struct memory *memory);

/* Makes a RESULT, with a ref to `blob` unless that is NULL. NULL without memory. */
struct reply *reply_result(uint64_t request, const struct control_result *result, struct blob *blob,
                           struct memory *memory);
/* Makes an ERROR. NULL without memory. */
struct reply *reply_error(uint64_t request, const struct bvhd_error *error, struct memory *memory);

/* NULL-safe. */
void reply_destroy(struct reply *reply);

#endif
