/* SPDX-License-Identifier: Apache-2.0 */
/* client_batch.h - what was asked for together: its items from waiting to their results. Under the client's lock. */
#ifndef BVHD_CLIENT_BATCH_H
#define BVHD_CLIENT_BATCH_H

#include "client/client.h"
#include "proto/wire/control.h"
#include "client/vulkan_input.h"

enum item_state {
    ITEM_WAITING, /* in the caller's memory */
    ITEM_COPIED, /* in ours, not sent */
    ITEM_SENT,
    ITEM_DONE,
};

struct batch_item {
    enum item_state state;
    struct held held; /* ITEM_COPIED */
    struct exchange *exchange; /* ITEM_SENT: where its answer comes */
    uint32_t entry;
    struct bvhd_result result; /* ITEM_DONE */
    char method[CONTROL_NAME_SIZE];
};

struct bvhd_batch {
    struct bvhd_client *client;
    struct bvhd_batch *next; /* in the queue */
    bool queued;
    int32_t priority;
    uint64_t deadline; /* for being sent, while there is no connection */
    struct vulkan_input *input; /* NULL: a batch of keys, or not needed any more */
    struct key *keys; /* NULL: a batch of builds */
    uint32_t remaining; /* items without result */
    uint32_t uncopied; /* ITEM_WAITING */
    uint32_t first_unsent, first_uncopied; /* all items before are beyond that */
    /* payload that the next frame may carry: the first ones are small, so that the daemon has something to do */
    uint64_t frame_bytes;
    uint32_t exchanges; /* that name this batch */
    uint32_t count;
    struct batch_item items[];
};

/* The end of an item that is not done, with its error. */
void client_batch_fail_item(struct bvhd_batch *batch, uint32_t item, const struct bvhd_error *error);

/* The end of an item that is not done, with its result: takes the blob. */
void client_batch_complete_item(struct bvhd_batch *batch, uint32_t item, const struct control_result *result,
                                struct bvhd_blob *blob);

/* The payload of an item is in our memory. */
void client_batch_set_copied(struct bvhd_batch *batch, uint32_t item);

/* All items that are not sent. */
void client_batch_fail_unsent(struct bvhd_batch *batch, const struct bvhd_error *error);

/* Takes a batch of which everything is sent out of the queue; its description is not needed any more. */
void client_batch_unqueue(struct bvhd_batch *batch);

#endif
