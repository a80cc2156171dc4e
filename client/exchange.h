/* SPDX-License-Identifier: Apache-2.0 */
/*
 * exchange.h - one frame to the daemon and the answers that it expects.
 *
 * An exchange with items (BUILD, GET) ends when every item has its result and, for BUILD, its PREPARED. It can outlive
 * its batch, because payloads must stay where they are until the daemon has released them. The frame's bytes are kept
 * until the first answer, because the daemon may answer BUSY.
 */
#ifndef BVHD_EXCHANGE_H
#define BVHD_EXCHANGE_H

#include <bvhd/bvhd.h>

#include "client/cache_state.h"
#include "client/connection_list.h"
#include "client/counter_list.h"
#include "proto/wire/frame.h"
#include "client/placement.h"

/* One item of an exchange. */
struct exchange_entry {
    uint32_t item; /* the item's position in the batch */
    bool prepared, answered;
    bool cancelled; /* the program does not want its result */
    struct held held;
};

/* A thread that waits for PONG, COUNTERS, CLIENT_LIST or CACHE_STATE; on that thread's stack. */
struct exchange_waiter {
    bool done;
    struct bvhd_error error;
    struct bvhd_counters *counters; /* these three are the thread's, if they came */
    struct bvhd_connections *connections;
    struct bvhd_cache_state *cache;
};

/* One frame and its answers. */
struct exchange {
    struct exchange *next; /* in the list that contains it */
    /* The frame: */
    enum frame_type type;
    uint64_t number; /* 0: no number yet */
    uint64_t sent; /* bytes */
    bool on_wire; /* completely sent: only then may it be answered */
    bool parked; /* the daemon answered BUSY */
    bool expects; /* it expects an answer; otherwise it ends once it is sent */
    unsigned char header[FRAME_HEADER_SIZE];
    struct bytes control, inline_bytes; /* owned, from library_memory */
    int descriptors[FRAME_MAX_DESCRIPTORS]; /* borrowed */
    uint32_t descriptor_count;
    /* Where the answers go: */
    struct bvhd_batch *batch; /* NULL: the batch is gone, or there is none */
    struct exchange_waiter *waiter;
    uint32_t count, unanswered, unprepared; /* numbers of entries */
    struct exchange_entry entries[];
};

/*
 * Creates an exchange with room for `capacity` entries, of which `count` (0) are in use. Returns NULL without memory.
 */
struct exchange *exchange_create(enum frame_type type, uint32_t capacity);

/* Frees an exchange whose payloads have been released. NULL is allowed. */
void exchange_destroy(struct exchange *exchange);

/* Writes the header. The control message and the inline bytes are complete. */
void exchange_seal(struct exchange *exchange, uint64_t request);

/* Returns whether the daemon has released any of the payloads. */
bool exchange_is_prepared(const struct exchange *exchange);

/* Frees the frame's bytes, which are not needed again. */
void exchange_drop_frame(struct exchange *exchange);

/* Returns the size of the whole frame in bytes. */
uint64_t exchange_frame_size(const struct exchange *exchange);

/* The exchanges that expect an answer, by their numbers. */
struct exchange_table {
    struct exchange **slots;
    uint32_t capacity, count;
    uint64_t serial;
};

void exchange_table_init(struct exchange_table *table);

/* Frees the table, whose exchanges must have been removed. */
void exchange_table_finish(struct exchange_table *table);

/*
 * Adds an exchange, and gives it a number that is not in use and has not been used recently. Returns false without
 * memory, or if 65,536 exchanges are under way.
 */
bool exchange_table_add(struct exchange_table *table, struct exchange *exchange);

/* Returns the exchange with that number, or NULL. */
struct exchange *exchange_table_find(const struct exchange_table *table, uint64_t number);

void exchange_table_remove(struct exchange_table *table, struct exchange *exchange);

#endif
