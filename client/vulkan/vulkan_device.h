/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_device.h - the caller's device as the library sees it: functions, limits, kinds of memory. Immutable once it
 * is there, so that any thread may use it.
 */
#ifndef BVHD_VULKAN_DEVICE_H
#define BVHD_VULKAN_DEVICE_H

#include <stdbool.h>
#include <stdint.h>

#include <bvhd/bvhd_vulkan.h>

#include "proto/base/memory.h"
#include "proto/base/status.h"

/* NULL where the device lacks what they need. */
struct vulkan_functions {
#define VULKAN_ALWAYS(name) PFN_vk##name name;
#define VULKAN_ADDRESS(name) PFN_vk##name name;
#define VULKAN_STRUCTURE(name) PFN_vk##name name;
#include "client/vulkan/vulkan_functions.def"
#undef VULKAN_ALWAYS
#undef VULKAN_ADDRESS
#undef VULKAN_STRUCTURE
};

/* UINT64_MAX where the device names none. */
struct vulkan_limits {
    uint64_t storage_range; /* bytes of a buffer that a shader sees at once */
    uint64_t storage_alignment; /* of an offset at which a storage buffer is bound */
    uint64_t allocation; /* bytes */
    uint64_t buffer; /* bytes */
    uint64_t primitives; /* of a bottom level */
    uint64_t instances; /* of a top level */
    uint64_t scratch_alignment;
};

struct bvhd_vulkan_device {
    VkDevice handle;
    const VkAllocationCallbacks *allocator;
    bool has_addresses;
    bool has_structures; /* and addresses, which they need */
    struct vulkan_functions vk;
    struct vulkan_limits limits;
    VkPhysicalDeviceMemoryProperties memory;
    char name[VK_MAX_PHYSICAL_DEVICE_NAME_SIZE];
    char driver[VK_MAX_DRIVER_NAME_SIZE +
                VK_MAX_DRIVER_INFO_SIZE]; /* "llvmpipe Mesa 25.0.7"; "" where the device does not tell */
};

/* BVHD_OK for VK_SUCCESS; else an error whose place is the name of the call, such as "vkCreateBuffer". */
enum bvhd_status vulkan_device_result(const char *call, VkResult result, struct bvhd_error *error);

#endif
