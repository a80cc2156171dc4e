/* SPDX-License-Identifier: Apache-2.0 */
/* vulkan_buffer.h - buffers with memory of their own, for what the library does by itself. */
#ifndef BVHD_VULKAN_BUFFER_H
#define BVHD_VULKAN_BUFFER_H

#include "client/vulkan/vulkan_device.h"

struct vulkan_buffer {
    VkBuffer buffer;
    VkDeviceMemory memory;
    VkDeviceSize size;
    VkDeviceAddress address; /* 0 without VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT */
    unsigned char *mapped; /* as long as it lives, and coherent; NULL on the device */
};

enum vulkan_place {
    VULKAN_DEVICE, /* local to the device where it has such memory left */
    VULKAN_HOST, /* mapped; for the host to write, or to read little */
    VULKAN_READBACK, /* mapped; for the host to read much: cached where there is such memory */
};

/* `size` is not 0. BVHD_NO_MEMORY, BVHD_TOO_LARGE. */
enum bvhd_status vulkan_buffer_create(const struct bvhd_vulkan_device *device, VkDeviceSize size,
                                      VkBufferUsageFlags usage, enum vulkan_place place,
                                      struct vulkan_buffer *ret_buffer, struct bvhd_error *error);

/* Idempotent; all zero is a buffer that is not there. */
void vulkan_buffer_destroy(const struct bvhd_vulkan_device *device, struct vulkan_buffer *buffer);

#endif
