/* SPDX-License-Identifier: Apache-2.0 */
/*
 * structure.h - what an object of bvhd_structure.h is made of, for the files of this folder. Functions return
 * BVHD_INVALID with the rule unless they say otherwise.
 */
#ifndef BVHD_STRUCTURE_H
#define BVHD_STRUCTURE_H

#include <bvhd/bvhd_structure.h>

#include "builder/format/positions.h"
#include "proto/base/bytes.h"
#include "proto/base/geometry.h"
#include "proto/base/status.h"

/* A structure that an object holds. `blob` is NULL in an object that is empty. */
struct structure_contents {
    struct bvhd_blob *blob;
    uint32_t type, flags; /* STRUCTURE_, BUILD_ */
    enum target target;
    uint32_t layout_flags; /* with which it was built */
    uint64_t body_size; /* what an object needs that is to hold it */
    uint64_t handle_count;
    uint64_t body_offset; /* of a portable structure: where its body begins in the blob */
    uint32_t motion_instances; /* of a top level that moves: its instances, inactive ones too; else 0 */
    struct positions *positions; /* NULL: a portable structure without ALLOW_DATA_ACCESS */
    bool is_compacted; /* by COMPACT, or possibly, before it was serialized: then updates need no more than it has */
};

struct bvhd_structure {
    uint32_t type; /* as created */
    uint64_t size;
    bool moves; /* created with the flag MOTION */
    uint64_t max_instances; /* of a top level that moves; UINT64_MAX: any number */
    struct structure_contents contents;
};

/* Returns the object of a handle; NULL for VK_NULL_HANDLE. */
struct bvhd_structure *structure_of(VkAccelerationStructureKHR handle);

/* The rules about the beginning of one of Vulkan's structs. */
struct structure_head {
    VkStructureType type;
    enum bvhd_vuid type_rule, chain_rule;
    const char *name; /* of the argument */
};

/* Checks sType, and that no struct follows. */
enum bvhd_status structure_check_head(const struct structure_head *head, const void *info, struct bvhd_error *error);

/* Checks that an argument is not NULL. */
enum bvhd_status structure_check_argument(const void *argument, const char *name, enum bvhd_vuid rule,
                                          struct bvhd_error *error);

/* Returns whether an object may hold a structure of this type. */
bool structure_takes(const struct bvhd_structure *structure, uint32_t type);

/* Returns whether an object was created with MOTION exactly if a structure was built with it, by these flags. */
bool structure_takes_motion(const struct bvhd_structure *structure, uint32_t flags);

/* Checks that an object was created for as many motion instances as a structure has. `where` names the object. */
enum bvhd_status structure_check_instances(const struct bvhd_structure *structure, uint32_t motion_instances,
                                           const char *where, struct bvhd_error *error);

/* Returns whether serialized bytes with these UUIDs can be read; `format` may be NULL. */
bool structure_is_compatible(const uint8_t uuids[2 * VK_UUID_SIZE], const struct bvhd_format *format);

/*
 * Reads a serialized structure from anywhere: checks all of its bytes. The contents refer to the blob, of which the
 * caller keeps a reference, and are ended with structure_release if no object takes them. The flags of a native
 * structure are 0, because they are not known. Returns BVHD_CORRUPT, BVHD_INCOMPATIBLE or BVHD_NO_MEMORY.
 */
enum bvhd_status structure_read(struct bvhd_blob *blob, struct structure_contents *ret_contents,
                                struct bvhd_error *error);

/* Ends what contents have beside their blob. */
void structure_release(const struct structure_contents *contents);

/* Makes an object hold the contents, which it takes over with their blob, instead of what it has. */
void structure_replace(struct bvhd_structure *structure, const struct structure_contents *contents);

/*
 * Computes the size of a build with at most these counts of primitives. The errors are those of bvhd_structure_sizes.
 */
enum bvhd_status structure_bound(const VkAccelerationStructureBuildGeometryInfoKHR *info, const uint32_t *counts,
                                 const struct build_options *options, uint64_t *ret_size, struct bvhd_error *error);

#endif
