/* SPDX-License-Identifier: Apache-2.0 */
/*
 * flight.h - builds under way, by key: what several ask for at once is built once.
 *
 * A flight waits for memory, then for threads, then is built, and lands: its blob goes to the cache and to every
 * waiter. Waiters may join at any time before that, and leave at any time. When the last one leaves, the build is told
 * to stop and its key is free for a new flight at once, so nobody inherits a cancellation. A build that ran short of
 * memory while others were running is tried once more, alone. Loop thread only.
 */
#ifndef BVHD_FLIGHT_H
#define BVHD_FLIGHT_H

#include "daemon/service/admission.h"
#include "daemon/service/blob.h"
#include "daemon/service/cache.h"
#include "daemon/service/counters.h"
#include "daemon/service/fair_queue.h"
#include "daemon/pool/pool.h"
#include "daemon/service/preparation.h"

struct flight;

/* A client's claims: to memory for builds, to threads. */
struct flight_client {
    struct fair_lane lanes[ADMISSION_CLASSES];
    struct pool_flow *flow;
};

struct flight_landing {
    struct blob *blob; /* borrowed; NULL when the build failed */
    const struct bvhd_error *error; /* if it failed */
    bool own; /* this waiter started it */
    double build_ms;
};

/* Lies in its owner's struct. Zeroed, then filled by the owner down to the line. */
struct flight_waiter {
    void (*landed)(struct flight_waiter *waiter, const struct flight_landing *landing); /* it has left already */
    struct flight_client *client;
    int priority; /* PRIORITY_ */
    /* the flight's own */
    struct flight *flight; /* NULL: waits for none */
    struct flight_waiter *previous, *next;
    bool own;
};

struct flights {
    /* of the service, filled before flights_init */
    struct pool *pool;
    struct pool_flow *housekeeping; /* for what frees memory */
    struct memory *memory;
    struct memory *large; /* within that: for builds that are not small */
    struct admission *admission;
    struct cache *cache;
    struct blob_account *account;
    struct counters *counters;
    /* its own */
    struct flight **buckets;
    uint64_t mask;
    struct fair_queue waiting[ADMISSION_CLASSES]; /* for memory */
    uint32_t running; /* jobs, those of abandoned flights included */
    uint32_t disposals; /* jobs that free a copy */
    uint64_t started; /* builds so far */
};

/* `most`: how many flights there may be, roughly. */
enum bvhd_status flights_init(struct flights *flights, uint32_t most, struct bvhd_error *error);

/* Nothing flies or winds down any more. */
void flights_finish(struct flights *flights);

/* The flight of that key, or NULL. One that was abandoned is not found. */
struct flight *flights_find(const struct flights *flights, const struct key *key);

/* Starts one; there is none of that key. Takes the preparation, also when it fails: BVHD_NO_MEMORY. */
enum bvhd_status flights_start(struct flights *flights, struct preparation *preparation, struct flight_waiter *waiter,
                               struct bvhd_error *error);

/* How many wait for memory. */
uint32_t flights_waiting(const struct flights *flights);

void flight_join(struct flight *flight, struct flight_waiter *waiter);

/* Harmless when it waits for none. */
void flight_leave(struct flights *flights, struct flight_waiter *waiter);

/*
 * Gives waiting flights to the pool as memory allows. Whoever has changed something calls it before the loop goes on.
 */
void flights_pump(struct flights *flights);

/* Frees a copy, away from the loop when that takes long, and ends its promise. NULL-safe. */
void flights_dispose(struct flights *flights, struct preparation *preparation);

/* Bytes that a build takes at its peak beside its canonical copy. */
uint64_t flights_build_bytes(const struct preparation *preparation);

#endif
