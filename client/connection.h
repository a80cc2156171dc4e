/* SPDX-License-Identifier: Apache-2.0 */
/*
 * connection.h - one socket to a daemon: frames out and in, what is under way on it, and what the daemon allows. It
 * never blocks, and knows nothing of batches: frames go up to a handler.
 */
#ifndef BVHD_CONNECTION_H
#define BVHD_CONNECTION_H

#include "proto/wire/control.h"
#include "client/exchange.h"

enum connection_state {
    CONNECTION_HELLO, /* WELCOME has not come */
    CONNECTION_OPEN,
    CONNECTION_LEAVING, /* the daemon goes: what is under way is finished, nothing new is taken */
};

/* Whether payloads may lie in the client's pool. */
enum connection_pool { POOL_UNASKED, POOL_ASKED, POOL_READY, POOL_REFUSED };

/* Of the daemon, made sane: never 0, never over what this version knows. */
struct connection_limits {
    uint32_t credits, max_items, max_control, max_inline;
    uint64_t max_pool; /* 0: none */
    uint64_t max_payload;
};

struct exchange_list {
    struct exchange *head, *tail;
};

struct connection {
    int socket;
    enum connection_state state;
    enum connection_pool pool;
    uint64_t pool_again; /* when a refused pool is tried again; 0: never */
    struct connection_limits limits;
    uint32_t credits; /* left */
    struct frame_parser parser;
    struct exchange_table table; /* what expects an answer */
    struct exchange_list outgoing; /* not, or not wholly, sent */
    struct exchange_list parked; /* the daemon was BUSY: again at busy_until */
    uint64_t busy_until; /* 0: not busy */
    bool is_blocked; /* the socket takes no more bytes until it is writable */
    bool is_starved; /* nor because the kernel is short of something: that is for a clock to try again */
    uint32_t watched; /* the poll events that waiting threads, and the program's loop, know of; 0: none yet */
    bool in_loop; /* the program's epoll descriptor knows it */
    uint64_t opened_at;
    uint64_t heard_at; /* when bytes came; or when something was first owed */
    uint64_t pinged_at; /* 0: no PING since then */
};

/*
 * Connects to the socket at `path` and says HELLO. BVHD_UNAVAILABLE: nobody there; BVHD_BUSY: somebody, who has no
 * time; BVHD_IO, BVHD_NO_MEMORY.
 */
enum bvhd_status connection_create(const char *path, uint64_t now, struct connection **ret_connection,
                                   struct bvhd_error *error);

/*
 * Nothing more is sent. Exchanges that expect an answer are in the table alone afterwards, for their owner to take out.
 */
void connection_silence(struct connection *connection);

/* The table must be empty. NULL-safe. */
void connection_destroy(struct connection *connection);

/*
 * Queues a frame (control, inline bytes and descriptors are set) and sends what the socket takes. One that expects an
 * answer goes into the table, but with request 0 on the wire for HELLO. False without memory: the exchange is still the
 * caller's. When the socket is broken connection_flush says so later.
 */
bool connection_send(struct connection *connection, struct exchange *exchange, uint64_t now);

/* A frame with an empty control message. False as above, then there is no exchange. */
bool connection_send_empty(struct connection *connection, enum frame_type type, struct exchange_waiter *waiter,
                           uint64_t now);

/* CANCEL of these entries of an exchange; count 0: all. Best effort: without memory the daemon works in vain. */
void connection_cancel(struct connection *connection, uint64_t request, const uint32_t *entries, uint32_t count,
                       uint64_t now);

/* BVHD_UNAVAILABLE: the daemon has gone. */
enum bvhd_status connection_flush(struct connection *connection, struct bvhd_error *error);

/* Judges a frame; the descriptors in it are the handler's. Anything but BVHD_OK ends the receiving. */
typedef enum bvhd_status (*connection_handler)(void *context, struct connection *connection, struct frame *frame,
                                               struct bvhd_error *error);

/*
 * Takes what has come. BVHD_UNAVAILABLE: the daemon has gone; BVHD_CORRUPT, BVHD_TOO_LARGE: it sends nonsense;
 * BVHD_NO_MEMORY, BVHD_IO: no place for it.
 */
enum bvhd_status connection_receive(struct connection *connection, connection_handler handler, void *context,
                                    uint64_t now, struct bvhd_error *error);

/* The daemon was BUSY: the exchange waits until `until`. */
void connection_park(struct connection *connection, struct exchange *exchange, uint64_t until);

/* The time has come: all that is parked, in order, taken off the list. */
struct exchange *connection_unpark(struct connection *connection);

/* Sends a parked exchange again. */
void connection_resend(struct connection *connection, struct exchange *exchange);

/* Limits of WELCOME; says whether the version fits. */
enum bvhd_status connection_welcome(struct connection *connection, const struct control_welcome *welcome,
                                    struct bvhd_error *error);

#endif
