/* SPDX-License-Identifier: Apache-2.0 */
/* client_batch.h - the items of one batch, from the call to their results. All functions require the client's lock. */
#ifndef BVHD_CLIENT_BATCH_H
#define BVHD_CLIENT_BATCH_H

#include "client/client.h"
#include "client/result_blocks.h"
#include "proto/wire/control.h"
#include "client/vulkan_input.h"

/* The progress of an item. */
enum client_item_state {
    ITEM_BLOCKED, /* it names structures that are not known yet (dependency.h) */
    ITEM_WAITING, /* its payload is in the caller's memory */
    ITEM_COPIED, /* its payload is in the client's memory, not sent yet */
    ITEM_SENT,
    ITEM_BUILDING, /* a thread of this process builds it */
    ITEM_DONE,
};

/* One item of a batch. */
struct client_item {
    enum client_item_state state;
    bool is_private; /* ITEM_BLOCKED and ITEM_WAITING: its payload is not in the caller's memory */
    uint32_t blockers; /* ITEM_BLOCKED: number of references that are not complete */
    struct held held; /* ITEM_COPIED: where the payload is */
    struct bvhd_blob *source; /* before ITEM_DONE, of an update: its source, a reference; NULL: not known here */
    struct local_micromaps *micromaps; /* before ITEM_DONE: those that were built here; NULL: none */
    struct exchange *exchange; /* ITEM_SENT: the exchange that will bring the answer */
    uint32_t entry; /* ITEM_SENT: the item's position in that exchange */
    uint32_t thousandths; /* ITEM_SENT: how far its build is */
    struct bvhd_result result; /* ITEM_DONE: the result */
    char method[SUMMARY_METHOD_SIZE];
    struct local_item local;
};

/* A batch; client_batch.c and client_submit.c own it. */
struct bvhd_batch {
    struct bvhd_client *client;
    struct bvhd_batch *next; /* in a queue of the client */
    bool queued;
    bool is_local; /* the queue is that of local builds */
    bool is_refused; /* it needed a local build, and no thread may do that */
    uint64_t submitted_at;
    int32_t priority;
    uint64_t connect_by; /* when unsent items fail if there is still no connection */
    uint32_t deadline_ms; /* from submitted_at on; 0: none */
    bool is_timed; /* it has a deadline and items without a result */
    struct list_link timed; /* is_timed: in client.timed */
    struct vulkan_input *input; /* NULL: a batch of keys, or no longer needed */
    struct key *keys; /* NULL: a batch of builds */
    struct dependencies *dependencies; /* NULL: no item depends on another, or on a key */
    struct bvhd_batch *parent; /* of a batch that looks up bounds: the one that needs them, and owns it */
    uint32_t remaining; /* number of items without a result */
    bvhd_batch_callback callback; /* NULL: none */
    void *user;
    struct bvhd_batch *next_called; /* in the list of functions to call */
    bool has_called; /* the callback is in that list, or was called */
    uint32_t uncopied; /* number of items that are ITEM_WAITING, with their payload in the caller's memory */
    uint32_t first_unsent, first_uncopied; /* all items before these have been sent, or copied */
    /*
     * The payload bytes that the next frame may carry. The first frames are small, so that the daemon can start early.
     */
    uint64_t frame_bytes;
    uint32_t exchanges; /* number of exchanges that point to this batch */
    struct result_blocks blocks; /* where results are that come inside frames */
    uint32_t count;
    struct client_item items[];
};

/* Makes a batch of items that wait. Returns NULL without memory. */
struct bvhd_batch *client_batch_create(struct bvhd_client *client, uint32_t count, int32_t priority);

/* Makes a batch of keys, which the caller fills in. Returns NULL without memory. */
struct bvhd_batch *client_batch_create_keys(struct bvhd_client *client, uint32_t count, int32_t priority);

/* Frees a batch that nothing points to. NULL is allowed. */
void client_batch_free(struct bvhd_batch *batch);

/* Ends an item that is not done, with an error. */
void client_batch_fail_item(struct bvhd_batch *batch, uint32_t item, const struct bvhd_error *error);

/* Ends an item that is not done, with its result. Takes over the caller's reference to the blob. */
void client_batch_complete_item(struct bvhd_batch *batch, uint32_t item, const struct control_result *result,
                                struct bvhd_blob *blob);

/* Ends an item that is not done, with the result of another one that holds the same structure. */
void client_batch_share_item(struct bvhd_batch *batch, uint32_t item, const struct client_item *other);

/* Records how far the build of an item is, in thousandths. A number that is less than the last one is old. */
void client_batch_set_progress(struct bvhd_batch *batch, uint32_t item, uint32_t thousandths);

/* Records that the payload of an item is in the client's memory. */
void client_batch_set_copied(struct bvhd_batch *batch, uint32_t item);

/* Ends all items that are not done, with an error, those of a lookup too; the daemon stops working on them. */
void client_batch_end(struct bvhd_batch *batch, const struct bvhd_error *error);

/* Ends all items that are not sent, with an error. */
void client_batch_fail_unsent(struct bvhd_batch *batch, const struct bvhd_error *error);

/* Puts a batch into the queue of local builds or that for a daemon, behind older batches of the same priority. */
void client_batch_enqueue(struct bvhd_batch *batch, bool is_local);

/* Takes a batch out of its queue once everything is sent, and frees its description. */
void client_batch_unqueue(struct bvhd_batch *batch);

#endif
