/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_device.h - the program's device: its functions, limits and memory types. It is immutable once created, so that
 * any thread may use it.
 */
#ifndef BVHD_VULKAN_DEVICE_H
#define BVHD_VULKAN_DEVICE_H

#include <stdbool.h>
#include <stdint.h>

#include <bvhd/bvhd_vulkan.h>

#include "proto/base/memory.h"
#include "proto/base/status.h"

/* A function is NULL if the device lacks its extension or feature. */
struct vulkan_functions {
#define VULKAN_ALWAYS(name) PFN_vk##name name;
#define VULKAN_ADDRESS(name) PFN_vk##name name;
#define VULKAN_STRUCTURE(name) PFN_vk##name name;
#include "client/vulkan/vulkan_functions.def"
#undef VULKAN_ALWAYS
#undef VULKAN_ADDRESS
#undef VULKAN_STRUCTURE
};

/* The device's limits. UINT64_MAX: the device announces none. */
struct vulkan_limits {
    uint64_t storage_range; /* the bytes of a buffer that a shader can access through one binding */
    uint64_t storage_alignment; /* bytes, of the offset at which a storage buffer is bound */
    uint64_t allocation; /* the most bytes in one allocation */
    uint64_t buffer; /* the most bytes in one buffer */
    uint64_t primitives; /* per bottom level */
    uint64_t instances; /* per top level */
    uint64_t scratch_alignment;
};

/* Properties of the device's compute shaders, by which tracing kernels are chosen. */
struct vulkan_compute {
    uint32_t api_version; /* of Vulkan */
    uint32_t vendor; /* vendorID */
    VkPhysicalDeviceType type;
    uint32_t max_groups; /* workgroups of a dispatch in x */
    uint32_t max_group_size; /* invocations of a workgroup */
    uint32_t subgroup_size;
    VkSubgroupFeatureFlags subgroup_operations; /* in compute shaders */
    uint32_t multiprocessors, warps; /* warps of one multiprocessor; NVIDIA devices only, 0: not known */
};

/* The program's device, as bvhd_vulkan_device_create found it. */
struct bvhd_vulkan_device {
    VkDevice handle;
    const VkAllocationCallbacks *allocator;
    bool has_addresses;
    bool has_structures; /* true only if has_addresses is, which structures need */
    struct vulkan_functions vk;
    struct vulkan_limits limits;
    struct vulkan_compute compute;
    VkPhysicalDeviceMemoryProperties memory;
    char name[VK_MAX_PHYSICAL_DEVICE_NAME_SIZE];
    /* for example "llvmpipe Mesa 25.0.7"; "" if the device does not say */
    char driver[VK_MAX_DRIVER_NAME_SIZE + VK_MAX_DRIVER_INFO_SIZE];
};

/* Returns BVHD_OK for VK_SUCCESS, otherwise an error whose place is the name of the call, such as "vkCreateBuffer". */
enum bvhd_status vulkan_device_result(const char *call, VkResult result, struct bvhd_error *error);

#endif
