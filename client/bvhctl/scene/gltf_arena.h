/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf_arena.h - parses JSON by cJSON into few large blocks, which is twice as fast as one allocation for each value,
 * and is freed at once.
 */
#ifndef BVHCTL_GLTF_ARENA_H
#define BVHCTL_GLTF_ARENA_H

#include <stdbool.h>
#include <stddef.h>

#include "proto/base/memory.h"

struct cJSON;
struct gltf_block;

struct gltf_arena {
    struct memory memory; /* without a limit: parsed JSON is no geometry */
    struct gltf_block *blocks; /* the newest first */
    size_t block_size; /* of the next block */
    bool failed; /* there was no memory */
};

/*
 * Parses a text of `size` bytes. *ret_end is where the JSON, or an error in it, ended. Returns NULL when it is no JSON,
 * or when there was no memory (arena->failed). The result lives until gltf_arena_finish; it is not deleted by cJSON.
 * Other threads may use cJSON meanwhile.
 */
const struct cJSON *gltf_arena_parse(struct gltf_arena *arena, const char *text, size_t size, const char **ret_end);

/* Frees everything. A zeroed arena is allowed. */
void gltf_arena_finish(struct gltf_arena *arena);

#endif
