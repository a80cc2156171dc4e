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
 * that is cancelled while a worker prepares it is LEAVING: its result, BVHD_CANCELLED, is sent at once; its payload is
 * given back and it becomes ANSWERED when the worker is done. An item of GET is NEW, then JOINED or ANSWERED;
 * where there is a disk, it is WAITING for its turn before it joins a lookup there.
 *
 * A request reports three things to its session, by struct request_events: the result of each item; which payloads are
 * not needed any more (collected, and reported at the end of the loop iteration); and its own end, after which it is
 * freed.
 */
#ifndef BVHD_REQUEST_H
#define BVHD_REQUEST_H

#include "daemon/service/flight.h"
#include "daemon/session/peer.h"
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
    /* The request is about to be freed. */
    void (*ended)(struct request_client *client, struct request *request);
};

/* The side of a session that its requests use. */
struct request_client {
    struct service *service;
    struct session_peer peer;
    const struct request_events *events;
    struct user_member member; /* the connection's shares */
    /* claims of the items that have started and are not answered: an estimate of what their results take */
    uint64_t started_bytes;
    bool gone; /* nothing is reported any more, except the end of requests */
};

/* Where the time of an item has gone, in milliseconds; what it has not waited for, or not done, is 0. */
struct item_times {
    uint64_t queued_ns; /* when it began to wait for memory to be prepared */
    double memory_ms, threads_ms; /* waited for them, to be prepared and to be built */
    double prepare_ms;
    double disk_ms; /* of the lookup of its result on disk, unless another item had started it */
    double build_ms, repeated_ms; /* of its own build (flight_times) */
    uint32_t waiters; /* items that its flight completed, told to the first of them; 0 for the others */
};

struct item {
    struct request *request;
    uint32_t index; /* its number in the request, from 0 */
    enum item_state state;
    bool pooled; /* its payload is in the client's shared memory pool */
    bool is_prepared; /* its payload is not needed any more */
    bool is_reported; /* the client has been told that the payload is not needed any more */
    struct control_item asked; /* what the client asked for */
    struct preparation_source source; /* where its payload is; empty after a preparation has taken it over */
    struct preparation *preparation; /* from its first PREPARING until a flight takes it */
    struct memory_waiter memory; /* in the queue for memory while WAITING; its claim is for preparing */
    uint64_t started_bytes; /* what this item adds to client->started_bytes: its claim, or 0 */
    struct pool_job job; /* prepares it on a worker, while PREPARING and LEAVING */
    struct flight_waiter waiter; /* waits for a flight while JOINED */
    uint32_t told_thousandths; /* the last progress that the client was sent */
    struct key key;
    struct item_times times;
};

struct request {
    struct request_client *client;
    uint64_t number;
    int priority; /* PRIORITY_ */
    bool is_build;
    uint64_t arrived_ns, deadline_ns; /* by the clock of clock_ns; a deadline of 0: none */
    uint32_t deadline_ms; /* as the client gave it */
    struct handle_entry *destinations; /* the handles that its items build into, sorted; for VUID 03407 */
    uint32_t destination_count;
    uint32_t open; /* items that are not ANSWERED */
    /* items whose PREPARED has not been sent to the client; the request ends when this and `open` are 0 */
    uint32_t unreported;
    uint32_t to_report; /* how many of the unreported items are prepared, and will be in the next PREPARED */
    struct deferred_call report; /* deferred while `to_report` is not 0 */
    struct request *next; /* in the session's hash table: the next request in the same bucket */
    uint32_t attachments; /* how many descriptors came with it */
    uint64_t inline_bytes; /* of its frame, while payloads in it are needed; counted in the client's share */
    uint32_t unprepared; /* items whose payload is still needed */
    uint32_t count; /* of items */
    struct item items[];
};

struct request_head {
    uint64_t number;
    int priority;
    bool is_build;
    uint32_t count; /* of items */
    uint32_t deadline_ms; /* from now; 0: none */
};

/*
 * Creates a request whose items are all NEW; each has to be passed to exactly one of item_start, item_refuse and
 * item_get. Returns NULL without memory.
 */
struct request *request_create(struct request_client *client, const struct request_head *head);

/*
 * Queues an item of BUILD. The caller has set its asked, source and pooled; the item takes over the source's
 * references.
 */
void item_start(struct item *item);

/* Answers a NEW item with an error, and drops the references that its source holds. */
void item_refuse(struct item *item, const struct bvhd_error *error);

/* Answers an item of GET from the cache, or lets it join the flight of its key, or answers BVHD_NOT_FOUND. */
void item_get(struct item *item, const struct key *key);

/* Cancels an item: its result is BVHD_CANCELLED. Allowed in every state; does nothing if the item has its result. */
void item_cancel(struct item *item);

/* Cancels all items. May free the request. */
void request_cancel(struct request *request);

/* Cancels all items, because the request's deadline has passed: their results say so. May free the request. */
void request_expire(struct request *request);

/*
 * Frees the request if it has nothing left to do or to report. The caller calls it once after any number of calls of
 * item_start, item_refuse, item_get and item_cancel.
 */
void request_settle(struct request *request);

#endif
