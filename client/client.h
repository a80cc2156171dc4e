/* SPDX-License-Identifier: Apache-2.0 */
/*
 * client.h - the client's state, and how its parts reach each other. All of it is guarded by one lock, which every
 * public function takes.
 *
 * What happens flows one way: client_advance receives (incoming), looks at clocks (client_link) and sends (outgoing).
 * Whatever somebody may wait for stirs the client; client_unlock then wakes those who wait (client_wait).
 */
#ifndef BVHD_CLIENT_H
#define BVHD_CLIENT_H

#include <pthread.h>

#include <bvhd/bvhd.h>

#include "client/address.h"
#include "client/connection.h"
#include "client/library.h"
#include "client/placement.h"

/* How those who wait are woken. */
struct client_wakeups {
    int epoll; /* the program's: behind it the sockets, timer and notice */
    int timer, notice;
    int wake; /* for the thread that polls */
    uint64_t timer_at; /* when the timer fires; LIBRARY_NEVER: it is off */
    bool has_loop; /* the program has asked for the epoll descriptor */
    bool polling; /* a thread polls the sockets, without the lock */
    uint64_t polling_until; /* at the latest */
    uint32_t waiting; /* threads on the condition */
    bool stirred;
};

struct bvhd_client {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    struct address address;
    uint64_t connect_timeout, lost_after; /* ns */
    struct client_wakeups wakeups;
    struct placement placement;
    struct connection *current; /* NULL: none */
    struct connection *leaving; /* one that finishes what it has */
    struct bvhd_batch *queue; /* with items that are not sent; by priority, then by age */
    uint32_t wanted; /* threads that want a connection */
    uint64_t retry_at; /* not connecting before */
    uint32_t backoff_ms;
    uint32_t random; /* state of the jitter */
    struct bvhd_error last_error; /* why there is no connection */
    uint64_t failures; /* how often hope was given up */
};

/* Something has changed that somebody may wait for. */
static inline void client_stir(struct bvhd_client *client)
{
    client->wakeups.stirred = true;
}

/* Receives and looks at clocks: afterwards the connection is one that lives, as far as one can know. */
void client_look(struct bvhd_client *client);

/* Receives, looks at clocks, sends: what can be done now. */
void client_advance(struct bvhd_client *client);

#endif
