/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reply.h - one frame on its way to a client: who makes it hands it over, who sends or drops it destroys it. Loop
 * thread only.
 */
#ifndef BVHD_REPLY_H
#define BVHD_REPLY_H

#include "daemon/service/blob.h"
#include "proto/wire/control.h"
#include "proto/wire/frame.h"

struct reply {
    struct reply *next; /* its holder's */
    struct frame_header header; /* complete */
    struct bytes control; /* owned, from `memory` */
    struct memory *memory;
    struct blob *blob; /* NULL or a ref: its bytes follow inline, or its descriptor goes with the frame */
    uint32_t credits; /* items that this reply ends; given back once it has left */
};

/* A frame without blob; takes `control`, also when it fails and returns NULL. */
struct reply *reply_create(enum frame_type type, uint64_t request, struct bytes control, struct memory *memory);

struct reply *reply_result(uint64_t request, const struct control_result *result, struct blob *blob,
                           struct memory *memory);
struct reply *reply_error(uint64_t request, const struct bvhd_error *error, struct memory *memory);

void reply_destroy(struct reply *reply);

#endif
