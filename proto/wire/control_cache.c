/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/wire/control_codec.h"

#include "proto/wire/bvhd.pb-c.h"

enum bvhd_status control_pack_cache(const struct control_cache *cache, struct memory *memory, struct bytes *ret_bytes,
                                    struct bvhd_error *error)
{
    Bvhd__Cache message;
    bvhd__cache__init(&message);
    message.action = cache->action;
    message.bytes = cache->bytes;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static void fill_cache(const void *from, void *ret_plain)
{
    const Bvhd__Cache *message = from;
    struct control_cache *cache = ret_plain;
    cache->action = message->action;
    cache->bytes = message->bytes;
}

static const struct control_kind cache_kind = {"cache", &bvhd__cache__descriptor, sizeof(struct control_cache), NULL,
                                               fill_cache};
CONTROL_UNPACK(cache, struct control_cache)

enum bvhd_status control_pack_cache_state(const struct control_cache_state *state, struct memory *memory,
                                          struct bytes *ret_bytes, struct bvhd_error *error)
{
    Bvhd__CacheState message;
    bvhd__cache_state__init(&message);
    message.directory = control_constant(state->directory);
    message.counted = state->counted;
    message.entries = state->entries;
    message.bytes = state->bytes;
    message.budget = state->budget;
    message.memory_entries = state->memory_entries;
    message.memory_bytes = state->memory_bytes;
    message.memory_budget = state->memory_budget;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static void fill_cache_state(const void *from, void *ret_plain)
{
    const Bvhd__CacheState *message = from;
    struct control_cache_state *state = ret_plain;
    control_copy_text(message->directory, sizeof state->directory, state->directory);
    state->counted = message->counted;
    state->entries = message->entries;
    state->bytes = message->bytes;
    state->budget = message->budget;
    state->memory_entries = message->memory_entries;
    state->memory_bytes = message->memory_bytes;
    state->memory_budget = message->memory_budget;
}

static const struct control_kind cache_state_kind = {"cache_state", &bvhd__cache_state__descriptor,
                                                     sizeof(struct control_cache_state), NULL, fill_cache_state};
CONTROL_UNPACK(cache_state, struct control_cache_state)
