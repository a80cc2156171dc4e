/* SPDX-License-Identifier: Apache-2.0 */
/*
 * flight.h - in-flight builds, by key: equal structures that several clients ask for at the same time are built once.
 * An update is a build that starts from its source; its result is not kept on disk.
 *
 * Where results are kept on disk, a flight first looks its key up there. If the disk has no result, the flight waits
 * for memory, then for threads; it is then built, and completes: its blob goes to the cache and to every waiter.
 * Waiters may join at any time before the completion, and leave at any time. When the last one leaves, the lookup or
 * build is told to stop, and its key is free for a new flight at once, so nobody inherits a cancellation. A flight goes
 * on in the turn of the client that is served earliest among those that wait for it. A build that ran short of memory
 * beside others is tried again, alone (admission.h). For the loop thread only.
 *
 * A flight that GET has started has nothing to build: unless an item of BUILD joins it, it ends with BVHD_NOT_FOUND
 * when the disk has no result.
 */
#ifndef BVHD_FLIGHT_H
#define BVHD_FLIGHT_H

#include "daemon/service/blob.h"
#include "daemon/service/cache.h"
#include "daemon/service/counters.h"
#include "daemon/service/disk.h"
#include "daemon/service/disposal.h"
#include "daemon/service/memory_queue.h"
#include "daemon/pool/pool.h"
#include "daemon/service/preparation.h"
#include "daemon/service/user.h"
#include "proto/base/list.h"

struct flight;

/* Where the time of a flight went, in milliseconds. */
struct flight_times {
    double memory_ms, threads_ms; /* that it waited for them */
    double disk_ms; /* of the lookup on disk; 0: there was none */
    double build_ms; /* of the build that completed it */
    double repeated_ms; /* of a build before, which ran short of memory; 0: there was none */
};

struct flight_completion {
    struct blob *blob; /* borrowed; NULL after a failure */
    const struct bvhd_error *error; /* set after a failure; borrowed */
    enum result_origin origin; /* BUILT for the waiter whose preparation was built, else COALESCED or DISK */
    struct flight_times times; /* of the flight; a waiter with another origin than BUILT may have joined it later */
    uint32_t waiters; /* how many there were */
    bool first; /* this waiter is the first that is told */
};

/*
 * One item that waits for a flight. It is a member of its owner's struct. The owner zeroes it and sets the fields above
 * the line before flights_start or flight_join; the fields below it belong to the flight.
 */
struct flight_waiter {
    /* Called after the waiter has left the flight. */
    void (*completed)(struct flight_waiter *waiter, const struct flight_completion *completion);
    struct user_member *client; /* in whose turn the build may go on */
    int priority; /* PRIORITY_ */
    /* ---- belongs to the flight ---- */
    struct flight *flight; /* NULL: waits for none */
    struct list_link link;
    bool own; /* the flight has its preparation from this waiter */
};

struct flights {
    /* modules of the service, filled before flights_init */
    struct pool *pool;
    struct memory *memory; /* for the flights and their table */
    struct disposals *disposals;
    struct cache *cache;
    struct disk *disk; /* NULL: results are not kept on disk */
    struct blob_account *account;
    struct counters *counters;
    /* ---- its own ---- */
    struct flight **buckets;
    uint64_t mask;
    struct memory_queue waiting; /* for memory */
    /* jobs that are with the pool, including those of abandoned flights, which have no waiters left */
    uint32_t looking, running; /* lookups and builds */
};

/* Creates the table. `most` is roughly how many flights there may be at once. Fails with BVHD_NO_MEMORY only. */
enum bvhd_status flights_init(struct flights *flights, uint32_t most, struct admission *admission,
                              struct bvhd_error *error);

/* Frees the table. No flight may be left, not even an abandoned one. */
void flights_finish(struct flights *flights);

/* Returns the flight of that key, or NULL. Abandoned flights are not found. */
struct flight *flights_find(const struct flights *flights, const struct key *key);

/*
 * Starts a flight for a key that must have none; `waiter` is the first to wait for it. `preparation` is what is built
 * if the disk has no result; it may be NULL if there is a disk. It is taken over, also on failure. The only error is
 * BVHD_NO_MEMORY.
 */
enum bvhd_status flights_start(struct flights *flights, const struct key *key, struct preparation *preparation,
                               struct flight_waiter *waiter, struct bvhd_error *error);

/* The number of flights that wait for memory. */
uint32_t flights_waiting(const struct flights *flights);

/*
 * Adds a waiter, which waits for no flight yet. Takes over its preparation, which has the flight's key and may be NULL:
 * the flight uses it if it has none.
 */
void flight_join(struct flight *flight, struct preparation *preparation, struct flight_waiter *waiter);

/* Removes a waiter, and abandons a flight that has none left. Does nothing if the waiter waits for no flight. */
void flight_leave(struct flights *flights, struct flight_waiter *waiter);

/*
 * Returns how far the build is that a waiter waits for, in thousandths: 0 while it has not started, or if there is
 * none.
 */
uint32_t flight_thousandths(const struct flight_waiter *waiter);

/* For tests: where the flight of a waiter is in the order of builds. The waiter must wait for one. */
struct pool_flow *flight_flow(const struct flight_waiter *waiter);
int flight_priority(const struct flight_waiter *waiter);

/* Gives waiting flights to the pool as memory allows. */
void flights_pump(struct flights *flights);

#endif
