/* SPDX-License-Identifier: Apache-2.0 */
/*
 * outgoing.h - from queued batches to frames, as credits, memory and the daemon's limits allow. Under the client's
 * lock.
 */
#ifndef BVHD_OUTGOING_H
#define BVHD_OUTGOING_H

#include "client/client.h"

/* Sends and copies what can be sent and copied now. */
void outgoing_pump(struct bvhd_client *client);

/* Cancels entries of an exchange at the daemon: those of `entries[count]`, or all with count 0. */
void outgoing_cancel(struct bvhd_client *client, struct exchange *exchange, const uint32_t *entries, uint32_t count);

#endif
