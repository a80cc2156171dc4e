/* SPDX-License-Identifier: Apache-2.0 */
/*
 * request.h - what a client has asked for: items, each on its way to its answer. Loop thread only.
 *
 *     NEW -> WAITING (for memory) -> PREPARING (a worker) -> JOINED (a flight) -> ANSWERED
 *
 * PREPARING goes back to WAITING when it finds that it needs more memory. An item that is cancelled while a worker has
 * it is LEAVING: its result is told, the rest follows when the worker lets go of it. Items of GET are NEW, then JOINED
 * or ANSWERED.
 *
 * A request reports to its client: one result an item, news of payloads that are not needed any more (gathered, until
 * request_tell), and its end, after which it is gone.
 */
#ifndef BVHD_REQUEST_H
#define BVHD_REQUEST_H

#include "daemon/service/flight.h"
#include "daemon/service/service_internal.h"

enum item_state { ITEM_NEW, ITEM_WAITING, ITEM_PREPARING, ITEM_JOINED, ITEM_LEAVING, ITEM_ANSWERED, ITEM_STATES };

struct request;
struct request_client;

/* How a request reports. None may call back into it. */
struct request_events {
    void (*result)(struct request_client *client, const struct request *request, const struct control_result *result,
                   struct blob *blob);
    /* `items` NULL: there was no memory to say which. */
    void (*prepared)(struct request_client *client, const struct request *request, const struct control_items *items);
    void (*unpooled)(struct request_client *client); /* one payload of the pool is not needed any more */
    void (*moved)(struct request_client *client); /* `ahead` is another */
    void (*ended)(struct request_client *client, struct request *request); /* just before it is freed */
};

/* What requests know of the session that they belong to. */
struct request_client {
    struct service *service;
    const struct request_events *events;
    struct flight_client flights;
    struct fair_lane lanes[ADMISSION_CLASSES]; /* for preparing */
    /* bytes promised to items between their start and their answer: about what their results may take */
    uint64_t ahead;
    bool gone; /* nothing is reported but the end */
};

struct item {
    struct request *request;
    uint32_t index;
    enum item_state state;
    bool pooled; /* its payload lies in the client's pool */
    bool is_prepared, is_told; /* the payload is not needed any more; the client knows */
    struct control_item asked;
    struct preparation_source source; /* until a preparation takes it */
    struct preparation *preparation; /* from its first PREPARING until a flight takes it */
    uint64_t promise; /* bytes it asks for */
    uint64_t ahead; /* its part of the client's */
    struct fair_entry entry; /* while WAITING */
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
    uint32_t untold; /* items whose payload the client believes to be needed; both 0: the request ends */
    uint32_t to_tell; /* of those, the ones whose payload is not */
    struct request *next_news, *previous_news; /* the service's: requests with something to tell */
    struct request *next; /* the session's, with the same bucket */
    uint32_t attachments; /* descriptors that came with it */
    uint32_t count;
    struct item items[];
};

struct request_head {
    uint64_t number;
    int priority;
    bool is_build;
    uint32_t count;
};

/* Its items are NEW; each has to be given to exactly one of the next four. NULL without memory. */
struct request *request_create(struct request_client *client, const struct request_head *head);

/* Queues an item of BUILD: asked, source and pooled are filled, the source's refs are the item's. */
void item_start(struct item *item);
/* Fails one before anything was begun; refs of its source are dropped. */
void item_refuse(struct item *item, const struct bvhd_error *error);
/* An item of GET. */
void item_get(struct item *item, const struct key *key);
/* The client is not interested any more; harmless in every state. */
void item_cancel(struct item *item);

/* Cancels all items. The request may be gone afterwards. */
void request_cancel(struct request *request);

/* Frees the request if nothing of it is left to do or to say. After every group of calls above. */
void request_settle(struct request *request);

/* Tells all clients of their payloads that are not needed any more. */
void request_tell(struct service *service);

/* Lets items start as memory allows. */
void request_pump(struct service *service);

#endif
