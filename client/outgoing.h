/* SPDX-License-Identifier: Apache-2.0 */
/*
 * outgoing.h - turns queued batches into frames, as far as credits, memory and the daemon's limits allow. Requires the
 * client's lock.
 */
#ifndef BVHD_OUTGOING_H
#define BVHD_OUTGOING_H

#include "client/client.h"
#include "proto/wire/control.h"

/* Sends and copies everything that can be sent and copied now. */
void outgoing_pump(struct bvhd_client *client);

/* Returns what a request says about a description, except where its payload is. */
struct control_item outgoing_describe(const struct build_input *input);

/* Tells the daemons which results the program holds no longer. */
void outgoing_release(struct bvhd_client *client);

/* Sends CANCEL for the entries `entries[count]` of an exchange, or for all if count is 0. */
void outgoing_cancel(struct bvhd_client *client, struct exchange *exchange, const uint32_t *entries, uint32_t count);

#endif
