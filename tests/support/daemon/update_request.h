/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_request.h - asks a session for builds and updates of one structure each, and makes them without a service to
 * compare the results. For tests of updates: an unexpected failure fails the running test.
 */
#ifndef BVHD_TEST_UPDATE_REQUEST_H
#define BVHD_TEST_UPDATE_REQUEST_H

#include "tests/support/unit.h"

#include <stdlib.h>

#include "builder/update/build_entry.h"
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

/* A structure that is made in this process, without a service. */
struct update_made {
    struct memory memory;
    struct build_entry entry;
    struct build_made made;
};

/* `source` is NULL for a build. */
static inline void update_make(const struct build_input *input, const struct update_made *source,
                               struct update_made *ret_made)
{
    const struct limits limits = limits_default();
    struct bvhd_error error;
    memory_init(&ret_made->memory, UINT64_MAX);
    const struct build_context context = {.memory = &ret_made->memory, .parallel = &parallel_serial};
    struct build_input asked = *input;
    struct build_entry_source from = {.blob = {NULL, 0}};
    if (source) {
        asked.source_key = source->entry.key;
        from = (struct build_entry_source){{source->made.blob, source->made.size}, source->entry.record.bytes};
    }
    assert_int_equal(build_entry_prepare(&asked, 0, &limits, &from, &context, &ret_made->entry, &error), BVHD_OK);
    assert_int_equal(build_entry_make(&ret_made->entry, &from, &context, &ret_made->made, &error), BVHD_OK);
}

static inline void update_made_finish(struct update_made *made)
{
    build_entry_finish(&made->entry, &made->memory);
    memory_free(&made->memory, made->made.blob);
    assert_int_equal(made->memory.live, 0);
}

static inline void update_check_same(const struct world_event *event, const struct update_made *made)
{
    const struct control_result *result = event->result;
    const struct summary *summary = &made->made.summary;
    assert_int_equal(result->error.status, BVHD_OK);
    assert_int_equal(result->size, made->made.size);
    assert_memory_equal(event->bytes, made->made.blob, result->size);
    assert_true(key_equal(&result->key, &made->entry.key));
    assert_true(result->summary.decay == summary->decay);
    assert_int_equal(result->summary.refits, summary->refits);
    assert_string_equal(result->summary.method, summary->method);
    assert_true(result->summary.sah == summary->sah);
}

#endif
