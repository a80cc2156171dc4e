/* SPDX-License-Identifier: Apache-2.0 */
/*
 * item_internal.h - what request.c, item.c and item_prepare.c share.
 *
 * request.c: a request as a whole, and its reports of prepared payloads. item.c: the states of an item, its result, the
 * cache and flights. item_prepare.c: an item from the queue for memory to its canonical copy and key.
 */
#ifndef BVHD_ITEM_INTERNAL_H
#define BVHD_ITEM_INTERNAL_H

#include "daemon/session/request.h"

static inline struct service *item_service(const struct item *item)
{
    return item->request->client->service;
}

/* request.c: the item's payload is not needed any more. Once for each item of BUILD. */
void item_note_prepared(struct item *item);

/* Changes the state, and with it the counts of the request and of the client. */
void item_enter(struct item *item, enum item_state state);

/* Answers an item of which no worker has anything with an error. */
void item_fail(struct item *item, const struct bvhd_error *error);

/* Answers a prepared item from the cache, or lets it join the flight of its key, or starts that. */
void item_find_result(struct item *item);

/* Takes the preparation out of the item. */
struct preparation *item_take_preparation(struct item *item);

#endif
