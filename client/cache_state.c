/* SPDX-License-Identifier: Apache-2.0 */
#include "client/cache_state.h"

#include "client/library.h"
#include "proto/base/container_of.h"

struct cache_state {
    struct bvhd_cache_state state;
    struct control_cache_state *message; /* has the directory */
};

struct bvhd_cache_state *cache_state_create(struct control_cache_state *message)
{
    struct cache_state *made = memory_alloc(&library_memory, sizeof *made);
    if (!made) {
        memory_free(&library_memory, message);
        return NULL;
    }
    made->message = message;
    made->state = (struct bvhd_cache_state){
        .directory = message->directory,
        .entries = message->entries,
        .bytes = message->bytes,
        .budget = message->budget,
        .memory_entries = message->memory_entries,
        .memory_bytes = message->memory_bytes,
        .memory_budget = message->memory_budget,
        .counted = message->counted,
    };
    return &made->state;
}

void bvhd_cache_state_destroy(struct bvhd_cache_state *state)
{
    if (!state)
        return;
    struct cache_state *made = container_of(state, struct cache_state, state);
    memory_free(&library_memory, made->message);
    memory_free(&library_memory, made);
}
