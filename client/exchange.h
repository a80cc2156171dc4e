/* SPDX-License-Identifier: Apache-2.0 */
/*
 * exchange.h - a frame to the daemon and what is still expected of it.
 *
 * An exchange with items (BUILD, GET) ends when every item has its result and, of a BUILD, its PREPARED. It outlives
 * its batch: payloads lie where they lie until the daemon has let go of them. The frame's bytes are kept until the
 * first answer, for the daemon may be BUSY.
 */
#ifndef BVHD_EXCHANGE_H
#define BVHD_EXCHANGE_H

#include <bvhd/bvhd.h>

#include "client/counter_list.h"
#include "proto/wire/frame.h"
#include "client/placement.h"

struct exchange_entry {
    uint32_t item; /* of the batch */
    bool prepared, answered;
    bool cancelled; /* nobody waits for it */
    struct held held;
};

/* Who waits for a PONG or for COUNTERS; on that thread's stack. */
struct exchange_waiter {
    bool done;
    struct bvhd_error error;
    struct bvhd_counters *counters;
};

struct exchange {
    struct exchange *next; /* in the list that it waits in */
    /* The frame. */
    enum frame_type type;
    uint64_t number; /* 0: not given yet */
    uint64_t sent; /* bytes */
    bool on_wire; /* all of them: only now may it be answered */
    bool parked; /* the daemon was BUSY */
    bool expects; /* an answer; else it ends once it is sent */
    unsigned char header[FRAME_HEADER_SIZE];
    struct bytes control, inline_bytes; /* owned, from library_memory */
    int descriptors[FRAME_MAX_DESCRIPTORS]; /* borrowed */
    uint32_t descriptor_count;
    /* Whom it concerns. */
    struct bvhd_batch *batch; /* NULL: gone */
    struct exchange_waiter *waiter;
    uint32_t count, unanswered, unprepared; /* entries */
    struct exchange_entry entries[];
};

/* With room for `capacity` entries, none there yet. NULL without memory. */
struct exchange *exchange_create(enum frame_type type, uint32_t capacity);

/* Payloads must have been released. NULL-safe. */
void exchange_destroy(struct exchange *exchange);

/* Control and inline bytes are complete: writes the header. */
void exchange_seal(struct exchange *exchange, uint64_t request);

/* The daemon has let go of a payload. */
bool exchange_is_prepared(const struct exchange *exchange);

/* The frame is not needed again. */
void exchange_drop_frame(struct exchange *exchange);

uint64_t exchange_frame_size(const struct exchange *exchange);

/* Exchanges under way, by their numbers. */
struct exchange_table {
    struct exchange **slots;
    uint32_t capacity, count;
    uint64_t serial;
};

void exchange_table_init(struct exchange_table *table);

/* The exchanges must have been taken out. */
void exchange_table_finish(struct exchange_table *table);

/*
 * Gives the exchange a number that is not in use and was not for long. False without memory, or with 65,536 under way.
 */
bool exchange_table_add(struct exchange_table *table, struct exchange *exchange);

/* NULL when there is none. */
struct exchange *exchange_table_find(const struct exchange_table *table, uint64_t number);

void exchange_table_remove(struct exchange_table *table, struct exchange *exchange);

#endif
