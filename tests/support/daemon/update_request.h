/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_request.h - asks a session for builds and updates of one structure each. For tests of updates: an unexpected
 * failure fails the running test.
 */
#ifndef BVHD_TEST_UPDATE_REQUEST_H
#define BVHD_TEST_UPDATE_REQUEST_H

#include "tests/support/unit.h"

#include <stdlib.h>

#include "tests/support/daemon/session_world.h"

static uint64_t update_requests; /* the number of the last one */

/* Sends one item. Its payload lies in a memfd, so that it may have any size. */
static inline uint64_t update_ask(struct world_client *client, const struct build_input *input,
                                  const struct key *source)
{
    uint64_t size;
    unsigned char *payload = world_payload(input, &size);
    struct control_item item = world_item(input, size, SOURCE_MEMFD, 0);
    if (source)
        item.source_key = *source;
    const struct control_build build = {.memfd_count = 1, .memfd_sizes = {size}, .item_count = 1, .items = &item};
    int descriptor = world_memfd(payload, size, WORLD_SEALS_ONCE);
    world_build(client, ++update_requests, &build, (struct bytes){NULL, 0}, &descriptor);
    free(payload);
    return update_requests;
}

static inline const struct world_event *update_await(struct world_client *client, uint64_t request)
{
    return world_await_result(client, request, 0);
}

/* Builds, and returns the key. */
static inline struct key update_build(struct world_client *client, const struct build_input *input)
{
    const struct world_event *event = update_await(client, update_ask(client, input, NULL));
    if (event->result->error.status != BVHD_OK)
        fail_msg("%s: %s", event->result->error.where, event->result->error.text);
    return event->result->key;
}

static inline struct build_input update_of(const struct build_input *input)
{
    struct build_input update = *input;
    update.mode = MODE_UPDATE;
    update.source = 7;
    return update;
}

static inline void update_expect(const struct world_event *event, enum bvhd_status status, enum bvhd_vuid vuid,
                                 const char *where)
{
    const struct bvhd_error *error = &event->result->error;
    if (error->status != status || error->vuid != vuid || strcmp(error->where, where) != 0)
        fail_msg("%s, rule %d at %s: %s, rather than %s, rule %d at %s", bvhd_status_name(error->status), error->vuid,
                 error->where, error->text, bvhd_status_name(status), vuid, where);
}

#endif
