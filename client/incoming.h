/* SPDX-License-Identifier: Apache-2.0 */
/*
 * incoming.h - handles what the daemon sends. Nothing of it is trusted: a frame that does not fit ends the connection.
 * Requires the client's lock.
 */
#ifndef BVHD_INCOMING_H
#define BVHD_INCOMING_H

#include "client/client.h"

/* Receives on all connections. Afterwards lost connections are gone. */
void incoming_receive(struct bvhd_client *client, uint64_t now);

#endif
