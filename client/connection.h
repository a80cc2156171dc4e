/* SPDX-License-Identifier: Apache-2.0 */
/*
 * connection.h - one socket to a daemon: the frames in both directions, what is under way, and what the daemon allows.
 * It never blocks, and does not know batches: it passes received frames to a handler. Moments (`now`, `until` and the
 * fields below) are nanoseconds of CLOCK_MONOTONIC. The client's lock guards a connection.
 */
#ifndef BVHD_CONNECTION_H
#define BVHD_CONNECTION_H

#include "proto/wire/control.h"
#include "client/exchange.h"
#include "client/holdings.h"

/* The progress of a connection. */
enum connection_state {
    CONNECTION_HELLO, /* WELCOME has not come yet */
    CONNECTION_OPEN,
    CONNECTION_LEAVING, /* the daemon is ending: it finishes what is under way and takes nothing new */
};

/* Whether payloads may lie in the client's pool. */
enum connection_pool { POOL_UNASKED, POOL_ASKED, POOL_READY, POOL_REFUSED };

/* The daemon's limits, corrected: they are never 0 and never exceed what this version supports. */
struct connection_limits {
    uint32_t credits, max_items, max_control, max_inline;
    uint64_t max_pool; /* 0: no pool */
    uint64_t max_payload;
    bool has_builders; /* items may ask for other builders than the daemon's own, which it may lack */
    bool has_updates; /* items may be updates */
};

/* A list of exchanges in the order of sending. */
struct exchange_list {
    struct exchange *head, *tail;
};

/* One connection. Moments are nanoseconds of CLOCK_MONOTONIC. */
struct connection {
    int socket;
    enum connection_state state;
    enum connection_pool pool;
    uint64_t pool_again; /* the moment to offer a refused pool again; 0: never */
    struct connection_limits limits;
    uint32_t credits; /* items that may still be sent before a result comes */
    struct holdings *holdings; /* what the program holds of its results; NULL: the daemon does not count that */
    struct frame_parser parser;
    struct exchange_table table; /* exchanges that expect an answer */
    struct exchange_list outgoing; /* exchanges that are not completely sent */
    struct exchange_list parked; /* exchanges that the daemon refused with BUSY, to be sent again at busy_until */
    uint64_t busy_until; /* 0: not busy */
    bool is_blocked; /* the socket takes no more bytes until it is writable */
    bool is_starved; /* the kernel lacks memory or descriptors for sending; a timer triggers the next attempt */
    uint32_t watched; /* the poll events that waiting threads and the program's loop watch for; 0: none yet */
    bool in_loop; /* the program's epoll descriptor watches the socket */
    uint64_t opened_at;
    uint64_t heard_at; /* when bytes last came, or when the daemon first owed an answer */
    uint64_t pinged_at; /* when PING was sent; 0: not since heard_at */
};

/*
 * Connects to the socket at `path` and sends HELLO. Fails with BVHD_UNAVAILABLE if no daemon listens, BVHD_BUSY if the
 * daemon's backlog is full or it has just ended, BVHD_INVALID if the path is too long, BVHD_IO or BVHD_NO_MEMORY.
 * `error` is not NULL.
 */
enum bvhd_status connection_create(const char *path, uint64_t now, struct connection **ret_connection,
                                   struct bvhd_error *error);

/*
 * Stops sending: empties the lists of outgoing and parked exchanges. Exchanges that expect no answer are freed; the
 * others are still in the table, from which the caller removes them.
 */
void connection_silence(struct connection *connection);

/* Closes the socket and frees the connection, whose table must be empty. NULL is allowed. */
void connection_destroy(struct connection *connection);

/*
 * Queues a frame whose control message, inline bytes and descriptors are set, and sends what the socket takes. An
 * exchange that expects an answer goes into the table and gets its number. Returns false without memory; the exchange
 * then still belongs to the caller. A broken socket is reported by a later connection_flush.
 */
bool connection_send(struct connection *connection, struct exchange *exchange, uint64_t now);

/*
 * Sends a frame that consists of a control message, from library_memory, which may be empty and is taken over. Returns
 * false without memory.
 */
bool connection_ask(struct connection *connection, enum frame_type type, struct bytes control,
                    struct exchange_waiter *waiter, uint64_t now);

/*
 * Sends CANCEL for these entries of the exchange with the number `request`; count 0 means all. Without memory nothing
 * is sent, and the daemon does work that nobody needs.
 */
void connection_cancel(struct connection *connection, uint64_t request, const uint32_t *entries, uint32_t count,
                       uint64_t now);

/* A result of `size` bytes in a descriptor was not taken. */
void connection_decline(struct connection *connection, uint64_t size);

/* Tells the daemon which results the program has released since the last call, if there are any. */
void connection_release(struct connection *connection, uint64_t now);

/* Sends queued frames as far as the socket takes them. BVHD_UNAVAILABLE: the daemon is gone. */
enum bvhd_status connection_flush(struct connection *connection, struct bvhd_error *error);

/* Handles one frame. The handler owns the frame's descriptors. A status other than BVHD_OK ends the receiving. */
typedef enum bvhd_status (*connection_handler)(void *context, struct connection *connection, struct frame *frame,
                                               struct bvhd_error *error);

/*
 * Receives and handles what has come. BVHD_UNAVAILABLE: the daemon is gone; BVHD_CORRUPT, BVHD_TOO_LARGE: it breaks the
 * protocol; BVHD_NO_MEMORY, BVHD_IO: the bytes or descriptors could not be received.
 */
enum bvhd_status connection_receive(struct connection *connection, connection_handler handler, void *context,
                                    uint64_t now, struct bvhd_error *error);

/* Keeps an exchange that the daemon refused with BUSY until `until`. */
void connection_park(struct connection *connection, struct exchange *exchange, uint64_t until);

/* Returns all parked exchanges, in order, and empties the list. */
struct exchange *connection_unpark(struct connection *connection);

/* Sends a parked exchange again. */
void connection_resend(struct connection *connection, struct exchange *exchange);

/* Takes over the limits of WELCOME. BVHD_INCOMPATIBLE: the daemon speaks another version of the protocol. */
enum bvhd_status connection_welcome(struct connection *connection, const struct control_welcome *welcome,
                                    struct bvhd_error *error);

#endif
