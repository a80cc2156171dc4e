/* SPDX-License-Identifier: Apache-2.0 */
/* client_link.h - finding a daemon, and noticing that it is gone. Under the client's lock. */
#ifndef BVHD_CLIENT_LINK_H
#define BVHD_CLIENT_LINK_H

#include "client/client.h"

/* The current connection if requests can be sent on it, else NULL. */
struct connection *client_link_open(const struct bvhd_client *client);

/* Connects if somebody wants that and the time has come. */
void client_link_connect(struct bvhd_client *client, uint64_t now);

/* Clocks: silent daemons, waiting in vain for one, PINGs. */
void client_link_check(struct bvhd_client *client, uint64_t now);

/* When client_link_check or client_link_connect have something to do next; LIBRARY_NEVER. */
uint64_t client_link_deadline(const struct bvhd_client *client);

/*
 * A connection is at its end, and *error says why: what is under way on it fails with BVHD_UNAVAILABLE and that reason,
 * or for lack of memory with that. So does what waits to be sent; but while HELLO was not answered the search for a
 * daemon goes on, unless the answer cannot get better.
 */
void client_link_lose(struct bvhd_client *client, struct connection *connection, const struct bvhd_error *error);

/* GOODBYE. */
void client_link_leave(struct bvhd_client *client, struct connection *connection, uint64_t now);

/* An exchange has all its answers, or its daemon is lost: its payloads are free, its number too. */
void client_link_end(struct bvhd_client *client, struct connection *connection, struct exchange *exchange);

/* A leaving connection with nothing under way is closed. */
void client_link_tidy(struct bvhd_client *client);

#endif
