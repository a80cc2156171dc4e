/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_structure.h - structures that a Vulkan driver itself builds from our requests, with which ours are compared.
 */
#ifndef BVHD_TEST_DRIVER_STRUCTURE_H
#define BVHD_TEST_DRIVER_STRUCTURE_H

#include "builder/format/canonical.h"
#include "client/bvhctl/gpu/gpu.h"

struct driver_structure {
    VkAccelerationStructureKHR handle;
    VkAccelerationStructureTypeKHR type;
    struct gpu_buffer storage;
    uint64_t address; /* what instances refer to */
    uint64_t size; /* as created */
};

/*
 * Builds the structure on the device, with vkCmdBuildAccelerationStructuresKHR. `references` are addresses by row of
 * the canonical copy's references. The caller destroys the result with driver_structure_destroy.
 */
enum bvhd_status driver_structure_build(struct gpu *gpu, const struct canonical *canonical, const uint64_t *references,
                                        struct memory *memory, struct driver_structure *ret_structure,
                                        struct bvhd_error *error);

/* Builds a top level with one instance of `address` without a transform, because ray queries need a top level. */
enum bvhd_status driver_structure_top_of(struct gpu *gpu, uint64_t address, struct driver_structure *ret_structure,
                                         struct bvhd_error *error);

/* Loads a serialized structure whose handles are addresses already. */
enum bvhd_status driver_structure_load(struct gpu *gpu, const void *data, uint64_t size,
                                       struct driver_structure *ret_structure, struct bvhd_error *error);

/* Copies with VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR or COMPACT. */
enum bvhd_status driver_structure_copy(struct gpu *gpu, const struct driver_structure *from,
                                       VkCopyAccelerationStructureModeKHR mode, struct driver_structure *ret_structure,
                                       struct bvhd_error *error);

/* Returns the driver's serialized bytes; the caller frees them with memory_free. */
enum bvhd_status driver_structure_serialize(struct gpu *gpu, const struct driver_structure *structure,
                                            struct memory *memory, unsigned char **ret_data, uint64_t *ret_size,
                                            struct bvhd_error *error);

/* Accepts NULL, and a structure that is destroyed already. */
void driver_structure_destroy(struct gpu *gpu, struct driver_structure *structure);

#endif
