/* SPDX-License-Identifier: Apache-2.0 */
/*
 * item_internal.h - what request.c, item.c and item_prepare.c share.
 *
 * request.c: a request as a whole, and its reports of prepared payloads. item.c: the states of an item, its result, the
 * cache and flights. item_report.c: its latencies, and why it was slow. item_prepare.c: the way of an item of BUILD
 * from the queue for memory to its canonical copy and key.
 */
#ifndef BVHD_ITEM_INTERNAL_H
#define BVHD_ITEM_INTERNAL_H

#include "daemon/session/request.h"

static inline struct service *item_service(const struct item *item)
{
    return item->request->client->service;
}

/*
 * Called once for each item of BUILD, when its payload is not needed any more: the client is told so at the end of the
 * loop iteration. It is in request.c.
 */
void item_note_prepared(struct item *item);

/*
 * Changes the item's state, and updates what follows from it: request->open and the started_bytes of item and client.
 */
void item_enter(struct item *item, enum item_state state);

/*
 * Counts how long an item took, and logs it if it was slow. `result` is complete. It is in item_report.c.
 */
void item_report(const struct item *item, const struct control_result *result);

/* Cancels an item, in whatever state it is, and answers it with the error unless it has its result. */
void item_withdraw(struct item *item, const struct bvhd_error *error);

/* Answers an item with an error. No worker may still use its preparation. */
void item_fail(struct item *item, const struct bvhd_error *error);

/* Answers a prepared item from the cache; else lets it join the flight of its key, which it starts if there is none. */
void item_find_result(struct item *item);

/* Returns the preparation, which now belongs to the caller, and removes it from the item. */
struct preparation *item_take_preparation(struct item *item);

#endif
