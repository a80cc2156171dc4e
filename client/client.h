/* SPDX-License-Identifier: Apache-2.0 */
/*
 * client.h - the state of a client. One lock guards all of it, and every public function takes that lock.
 *
 * client_advance does the work in a fixed order: it receives (incoming), checks timeouts (client_link) and sends
 * (outgoing); threads that build in this process learn what there is to build (local_builds). A change that a thread
 * may wait for is marked with client_stir; client_unlock then wakes the waiting threads (client_wait).
 */
#ifndef BVHD_CLIENT_H
#define BVHD_CLIENT_H

#include <pthread.h>

#include <bvhd/bvhd.h>

#include "client/address.h"
#include "client/callback.h"
#include "client/connection.h"
#include "client/library.h"
#include "client/local_builds.h"
#include "client/placement.h"

/* How waiting threads and the program's event loop are woken. */
struct client_wakeups {
    /*
     * the descriptor that the program's event loop watches; it becomes readable for the sockets, `timer` and `notice`
     */
    int epoll;
    /* a timerfd, set to timer_at; an eventfd that tells the program's loop that another thread has changed something */
    int timer, notice;
    int wake; /* an eventfd that wakes the thread that polls */
    uint64_t timer_at; /* when the timer fires; LIBRARY_NEVER: it is off */
    bool has_loop; /* the program has asked for its descriptor */
    bool polling; /* a thread polls the sockets, with the lock dropped */
    uint64_t polling_until; /* until when it polls at most */
    uint32_t waiting; /* number of threads that wait on the condition variable */
    bool stirred; /* client_stir was called, and the waiting threads have not been woken yet */
};

/* A client. Moments are nanoseconds of CLOCK_MONOTONIC. */
struct bvhd_client {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    struct address address;
    uint64_t connect_timeout, lost_after; /* durations in ns */
    struct client_wakeups wakeups;
    struct callbacks callbacks;
    struct placement placement;
    struct local_builds local;
    struct connection *current; /* the connection for new requests; NULL: none */
    struct connection *leaving; /* a connection whose daemon is ending: it finishes what is under way; NULL: none */
    struct bvhd_batch *queue; /* batches with unsent items, by priority, then by age */
    struct list timed; /* batches with a deadline that are not done, the earliest first; by bvhd_batch.deadline */
    uint32_t wanted; /* number of threads that wait for a connection */
    uint64_t retry_at; /* no attempt to connect before this moment */
    uint32_t backoff_ms;
    uint32_t random; /* state of the random numbers that spread retries */
    struct bvhd_error last_error; /* why there is no connection */
    uint64_t failures; /* how often the search for a daemon was given up */
};

/* Marks that something has changed that a thread may wait for. */
static inline void client_stir(struct bvhd_client *client)
{
    client->wakeups.stirred = true;
}

/* Receives and checks timeouts. Afterwards a lost connection is gone, as far as this side can know. */
void client_look(struct bvhd_client *client);

/* Does all work that is possible now: receives, checks timeouts, connects, sends. */
void client_advance(struct bvhd_client *client);

#endif
