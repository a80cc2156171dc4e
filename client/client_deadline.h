/* SPDX-License-Identifier: Apache-2.0 */
/*
 * client_deadline.h - ends batches that take longer than the program wants to wait for them (bvhd_build.deadline_ms).
 * All functions require the client's lock.
 *
 * The client keeps deadlines itself, so that they hold for what is not sent yet, for builds in this process and for
 * daemons that do not know of them. A frame carries what is left of the time, so that the daemon stops working on it
 * even if the program makes no more calls.
 */
#ifndef BVHD_CLIENT_DEADLINE_H
#define BVHD_CLIENT_DEADLINE_H

#include <stdint.h>

struct bvhd_batch;
struct bvhd_client;

/* From now on watches a batch that has just been submitted, if it has a deadline and items that are not done. */
void client_deadline_add(struct bvhd_batch *batch);

/* Watches a batch no longer. */
void client_deadline_remove(struct bvhd_batch *batch);

/* Returns the moment of a batch's deadline; LIBRARY_NEVER: none. */
uint64_t client_deadline_of(const struct bvhd_batch *batch);

/* Returns the milliseconds that are left until a batch's deadline, at least 1; 0: it has none. */
uint32_t client_deadline_left_ms(const struct bvhd_batch *batch, uint64_t now);

/* Ends the batches whose deadline has passed. */
void client_deadline_check(struct bvhd_client *client, uint64_t now);

/* Returns the moment of the next deadline; LIBRARY_NEVER: none. */
uint64_t client_deadline_next(const struct bvhd_client *client);

#endif
