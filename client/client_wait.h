/* SPDX-License-Identifier: Apache-2.0 */
/*
 * client_wait.h - lets several threads wait at once, and wakes them.
 *
 * One of the waiting threads polls the sockets with the lock dropped; the others wait on a condition variable. When the
 * polling thread has what it waited for, another one takes over. A change by any thread wakes all of them, and makes
 * the program's epoll descriptor readable.
 */
#ifndef BVHD_CLIENT_WAIT_H
#define BVHD_CLIENT_WAIT_H

#include "client/client.h"

/* Prepares the lock and the descriptors of a new client. Fails with BVHD_NO_MEMORY or BVHD_IO. */
enum bvhd_status client_wait_init(struct bvhd_client *client, struct bvhd_error *error);
void client_wait_finish(struct bvhd_client *client);

/* Takes the client's lock, which all functions below except client_wait_finish require. */
void client_lock(struct bvhd_client *client);

/* Wakes the threads and the event loop that wait for what has changed, and drops the lock. */
void client_unlock(struct bvhd_client *client);

/* Drops the lock at the end of a call from the program's event loop, which needs no wake-up itself. */
void client_unlock_dispatched(struct bvhd_client *client);

/* The event that a thread waits for, and the work that it may do meanwhile. */
struct client_wait {
    bool (*is_true)(const void *context);
    /* Does a piece of work, and returns whether there was any. It may drop the lock meanwhile. NULL: there is none. */
    bool (*work)(struct bvhd_client *client, const void *context);
    const void *context;
};

/*
 * Waits until is_true returns true, or until `moment`; the lock is dropped meanwhile. Returns the last value of
 * is_true. It works, or receives and sends, at least once, begins no work after `moment`, and calls the callbacks of
 * batches that are done: `context` may be gone afterwards if that is a batch that its own callback destroys.
 */
bool client_wait_until(struct bvhd_client *client, uint64_t moment, const struct client_wait *wait);

/* Stops watching a connection that is about to end. */
void client_wait_forget(struct bvhd_client *client, struct connection *connection);

/* Clears the wake-up of the program's event loop, at the start of a dispatch. */
void client_wait_heard(struct bvhd_client *client);

#endif
