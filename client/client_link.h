/* SPDX-License-Identifier: Apache-2.0 */
/* client_link.h - finds a daemon, and notices when it is gone. All functions require the client's lock. */
#ifndef BVHD_CLIENT_LINK_H
#define BVHD_CLIENT_LINK_H

#include "client/client.h"

/* Returns the current connection if requests can be sent on it, else NULL. */
struct connection *client_link_open(const struct bvhd_client *client);

/* Connects, if a thread or a batch needs a connection and the next attempt is due. */
void client_link_connect(struct bvhd_client *client, uint64_t now);

/*
 * Checks timeouts: sends PING to a daemon that has been silent, ends the connection if it stays silent, and fails
 * batches that have waited too long for a daemon.
 */
void client_link_check(struct bvhd_client *client, uint64_t now);

/* Returns when client_link_check or client_link_connect have something to do next; LIBRARY_NEVER if they have not. */
uint64_t client_link_deadline(const struct bvhd_client *client);

/*
 * Ends a connection for the reason *error. What is under way on it fails with the text of that reason and
 * BVHD_UNAVAILABLE (BVHD_NO_MEMORY and BVHD_INCOMPATIBLE stay as they are). Requests that are not sent yet fail too,
 * except before the daemon has answered HELLO: the search for a daemon then goes on, unless the answer is final.
 */
void client_link_lose(struct bvhd_client *client, struct connection *connection, const struct bvhd_error *error);

/* Handles GOODBYE: the connection only finishes what is under way, and a new one is made for later requests. */
void client_link_leave(struct bvhd_client *client, struct connection *connection, uint64_t now);

/* Ends an exchange that has all its answers, or whose daemon is lost: frees its payloads and its number. */
void client_link_end(struct bvhd_client *client, struct connection *connection, struct exchange *exchange);

/* Closes the leaving connection if nothing is under way on it. */
void client_link_tidy(struct bvhd_client *client);

#endif
