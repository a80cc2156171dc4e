/* SPDX-License-Identifier: Apache-2.0 */
/* vulkan_buffer.h - buffers with their own memory, for the library's own use. */
#ifndef BVHD_VULKAN_BUFFER_H
#define BVHD_VULKAN_BUFFER_H

#include "client/vulkan/vulkan_device.h"

/* A buffer with its own memory. */
struct vulkan_buffer {
    VkBuffer buffer;
    VkDeviceMemory memory;
    VkDeviceSize size;
    VkDeviceAddress address; /* 0 without VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT */
    unsigned char *mapped; /* the mapping, coherent and valid for the buffer's whole life; NULL on the device */
};

/* Where a buffer's memory is, and how the host uses it. */
enum vulkan_place {
    VULKAN_DEVICE, /* local to the device, if it has such memory left */
    VULKAN_HOST, /* mapped; for the host to write, or to read a little */
    VULKAN_READBACK, /* mapped; for the host to read much: cached, if there is such memory */
};

/*
 * Creates a buffer of `size` bytes, not 0. Fails with BVHD_NO_MEMORY, BVHD_TOO_LARGE, or another Vulkan error
 * (vulkan_device_result).
 */
enum bvhd_status vulkan_buffer_create(const struct bvhd_vulkan_device *device, VkDeviceSize size,
                                      VkBufferUsageFlags usage, enum vulkan_place place,
                                      struct vulkan_buffer *ret_buffer, struct bvhd_error *error);

/* Frees a buffer. A struct that is all zero, and repeated calls, are allowed. */
void vulkan_buffer_destroy(const struct bvhd_vulkan_device *device, struct vulkan_buffer *buffer);

#endif
