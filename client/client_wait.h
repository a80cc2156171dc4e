/* SPDX-License-Identifier: Apache-2.0 */
/*
 * client_wait.h - waiting, from several threads at once, and waking.
 *
 * One of the waiting threads polls the sockets with the lock dropped; the others wait on a condition. When the one that
 * polls has what it wanted, another one takes over. A change by any thread wakes all of them, and makes the program's
 * epoll descriptor readable.
 */
#ifndef BVHD_CLIENT_WAIT_H
#define BVHD_CLIENT_WAIT_H

#include "client/client.h"

enum bvhd_status client_wait_init(struct bvhd_client *client, struct bvhd_error *error);
void client_wait_finish(struct bvhd_client *client);

void client_lock(struct bvhd_client *client);

/* Wakes whom it concerns. */
void client_unlock(struct bvhd_client *client);

/* As client_unlock, at the end of a call from the program's event loop. */
void client_unlock_dispatched(struct bvhd_client *client);

/* With the lock held, dropped meanwhile: until is_true says so, or the moment has come: then false. */
bool client_wait_until(struct bvhd_client *client, uint64_t moment, bool (*is_true)(const void *context),
                       const void *context);

/* Before a connection ends. */
void client_wait_forget(struct bvhd_client *client, struct connection *connection);

/* At the begin of a dispatch: the notice was heard. */
void client_wait_heard(struct bvhd_client *client);

#endif
