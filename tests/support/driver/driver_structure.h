/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_structure.h - the same requests, built by a Vulkan driver itself: what our structures are compared with.
 */
#ifndef BVHD_TEST_DRIVER_STRUCTURE_H
#define BVHD_TEST_DRIVER_STRUCTURE_H

#include "builder/format/canonical.h"
#include "client/bvhctl/gpu/gpu.h"

struct driver_structure {
    VkAccelerationStructureKHR handle;
    VkAccelerationStructureTypeKHR type;
    struct gpu_buffer storage;
    uint64_t address; /* what instances name */
    uint64_t size; /* as created */
};

/*
 * Builds it on the device, by vkCmdBuildAccelerationStructuresKHR. `references`: addresses, by row of the canonical
 * copy's references. End with driver_structure_destroy.
 */
enum bvhd_status driver_structure_build(struct gpu *gpu, const struct canonical *canonical, const uint64_t *references,
                                        struct memory *memory, struct driver_structure *ret_structure,
                                        struct bvhd_error *error);

/* A top level with one instance of `address`, without a transform: ray queries want one. */
enum bvhd_status driver_structure_top_of(struct gpu *gpu, uint64_t address, struct driver_structure *ret_structure,
                                         struct bvhd_error *error);

/* From a serialized structure whose handles are addresses already. */
enum bvhd_status driver_structure_load(struct gpu *gpu, const void *data, uint64_t size,
                                       struct driver_structure *ret_structure, struct bvhd_error *error);

/* VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR or COMPACT. */
enum bvhd_status driver_structure_copy(struct gpu *gpu, const struct driver_structure *from,
                                       VkCopyAccelerationStructureModeKHR mode, struct driver_structure *ret_structure,
                                       struct bvhd_error *error);

/* The driver's serialized bytes; the caller frees them with memory_free. */
enum bvhd_status driver_structure_serialize(struct gpu *gpu, const struct driver_structure *structure,
                                            struct memory *memory, unsigned char **ret_data, uint64_t *ret_size,
                                            struct bvhd_error *error);

/* NULL-safe, idempotent. */
void driver_structure_destroy(struct gpu *gpu, struct driver_structure *structure);

#endif
