/* SPDX-License-Identifier: Apache-2.0 */
/*
 * request.h - the requests of one client (BUILD and GET): items, each of which is on its way to its result. For the
 * loop thread only.
 *
 * An item of BUILD passes through these states:
 *
 *     NEW -> WAITING (for memory) -> PREPARING (on a worker) -> JOINED (waits for a flight) -> ANSWERED
 *
 * It goes back from PREPARING to WAITING when the worker finds that it needs more memory than it was promised. An item
 * that is cancelled while a worker has it is LEAVING: its result is sent at once, and the rest follows when the worker
 * is done. An item of GET is NEW, then JOINED or ANSWERED.
 *
 * A request reports to its client: one result for each item; which payloads are not needed any more (gathered, and
 * reported at the end of the loop iteration); and its own end, after which it is freed.
 */
#ifndef BVHD_REQUEST_H
#define BVHD_REQUEST_H

#include "daemon/service/flight.h"
#include "daemon/service/service_internal.h"

enum item_state { ITEM_NEW, ITEM_WAITING, ITEM_PREPARING, ITEM_JOINED, ITEM_LEAVING, ITEM_ANSWERED, ITEM_STATES };

struct request;
struct request_client;

/* How a request reports to the session. None of these may call a function of this header. */
struct request_events {
    /* An item has its result. `blob` is borrowed, and NULL after an error. */
    void (*result)(struct request_client *client, const struct request *request, const struct control_result *result,
                   struct blob *blob);
    /* The payloads of these items are not needed any more. `items` is NULL if there was no memory for the list. */
    void (*prepared)(struct request_client *client, const struct request *request, const struct control_items *items);
    /* One payload in the client's pool is not needed any more. */
    void (*pool_released)(struct request_client *client);
    /* client->started_bytes has changed. */
    void (*started_changed)(struct request_client *client);
    /* The request is about to be freed. */
    void (*ended)(struct request_client *client, struct request *request);
};

/* What requests know of the session that they belong to. */
struct request_client {
    struct service *service;
    const struct request_events *events;
    struct memory_lanes lanes; /* for preparing */
    struct flight_client flights;
    /* claims of the items that have started and are not answered: an estimate of what their results take */
    uint64_t started_bytes;
    bool gone; /* nothing is reported any more, except the end of requests */
};

struct item {
    struct request *request;
    uint32_t index; /* in its request */
    enum item_state state;
    bool pooled; /* its payload lies in the client's pool */
    bool is_prepared; /* its payload is not needed any more */
    bool is_reported; /* the client knows that it is prepared */
    struct control_item asked;
    struct preparation_source source; /* until a preparation takes it */
    struct preparation *preparation; /* from its first PREPARING until a flight takes it */
    struct memory_waiter memory; /* waits while WAITING; its claim is for preparing */
    uint64_t started_bytes; /* its share of the client's */
    struct pool_job job; /* while PREPARING and LEAVING */
    struct flight_waiter waiter; /* while JOINED */
    struct key key;
    double prepare_ms;
};

struct request {
    struct request_client *client;
    uint64_t number;
    int priority; /* PRIORITY_ */
    bool is_build;
    uint64_t arrived_ns;
    struct handle_entry *destinations; /* sorted */
    uint32_t destination_count;
    uint32_t open; /* items that are not ANSWERED */
    uint32_t unreported; /* items whose payload is needed for all that the client knows; both 0: the request ends */
    uint32_t to_report; /* those of them that are prepared */
    struct deferred_call report; /* deferred while `to_report` is not 0 */
    struct request *next; /* the session's, with the same bucket */
    uint32_t attachments; /* descriptors that came with it */
    uint32_t count;
    struct item items[];
};

struct request_head {
    uint64_t number;
    int priority;
    bool is_build;
    uint32_t count; /* of items */
};

/*
 * All its items are NEW; each has to be given to exactly one of item_start, item_refuse and item_get. NULL without
 * memory.
 */
struct request *request_create(struct request_client *client, const struct request_head *head);

/* Queues an item of BUILD, whose asked, source and pooled are filled. Takes the refs of the source. */
void item_start(struct item *item);

/* Answers a NEW item with an error, and drops the refs of its source. */
void item_refuse(struct item *item, const struct bvhd_error *error);

/* Answers an item of GET from the cache, or lets it join the flight of its key. */
void item_get(struct item *item, const struct key *key);

/* The client is not interested any more. Allowed in every state; does nothing after the result. */
void item_cancel(struct item *item);

/* Cancels all items. May free the request. */
void request_cancel(struct request *request);

/* Frees the request if it has nothing left to do or to report. To be called after every group of the calls above. */
void request_settle(struct request *request);

#endif
