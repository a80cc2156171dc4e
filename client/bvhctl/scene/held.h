/* SPDX-License-Identifier: Apache-2.0 */
/* held.h - a built file as an object with the rules of Vulkan's host commands (bvhd/bvhd_structure.h). */
#ifndef BVHCTL_HELD_H
#define BVHCTL_HELD_H

#include "bvhd/bvhd_structure.h"
#include "proto/base/memory.h"

struct held {
    struct bvhd_structure *structure; /* destroyed by the caller */
    struct bvhd_structure_state state;
};

/*
 * Reads a hostile file and deserializes it, whatever its target. `memory` limits what is read. Errors have the path as
 * their place: those of files_read, and of bvhd_structure_deserialize with its rule; BVHD_CORRUPT for bytes behind
 * the structure. End with bvhd_structure_destroy.
 */
enum bvhd_status held_open(const char *path, struct memory *memory, struct held *ret_held, struct bvhd_error *error);

/* Reads one of Vulkan's properties of a structure. Errors have no place. */
enum bvhd_status held_property(const struct held *held, VkQueryType type, uint64_t *ret_value,
                               struct bvhd_error *error);

/*
 * Copies by CLONE or COMPACT to a new structure, which is created with as many bytes as that mode needs, by the
 * property of the source.
 */
enum bvhd_status held_copy(const struct held *source, VkCopyAccelerationStructureModeKHR mode, struct held *ret_held,
                           struct bvhd_error *error);

#endif
