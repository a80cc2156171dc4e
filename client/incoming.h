/* SPDX-License-Identifier: Apache-2.0 */
/*
 * incoming.h - what the daemon says. Nothing of it is trusted: what does not fit ends the connection. Under the
 * client's lock.
 */
#ifndef BVHD_INCOMING_H
#define BVHD_INCOMING_H

#include "client/client.h"

/* Receives on all connections; lost ones are gone afterwards. */
void incoming_receive(struct bvhd_client *client, uint64_t now);

#endif
