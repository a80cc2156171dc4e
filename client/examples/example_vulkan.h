/* SPDX-License-Identifier: Apache-2.0 */
/*
 * example_vulkan.h - what every Vulkan program has somewhere: a device, buffers, a kernel. Nothing of it is about bvhd.
 * Failures end the program.
 */
#ifndef EXAMPLE_VULKAN_H
#define EXAMPLE_VULKAN_H

#include <vulkan/vulkan.h>

enum example_device { EXAMPLE_COMPUTE, EXAMPLE_ADDRESSES, EXAMPLE_RAY_QUERIES };

struct example_vulkan {
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    uint32_t family;
    VkCommandPool pool;
};

struct example_buffer {
    VkBuffer buffer;
    VkDeviceMemory memory;
    VkDeviceSize size;
    unsigned char *mapped; /* of a host-visible one */
    VkDeviceAddress address; /* with VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT */
};

/* Ends the program with status 77 when there is no such device. */
void example_open(struct example_vulkan *vulkan, enum example_device wanted);
void example_close(struct example_vulkan *vulkan);
void example_check(const char *what, VkResult result);

struct example_buffer example_buffer(const struct example_vulkan *vulkan, VkDeviceSize size, VkBufferUsageFlags usage,
                                     VkMemoryPropertyFlags properties);
void example_free(const struct example_vulkan *vulkan, struct example_buffer *buffer);

VkCommandBuffer example_begin(const struct example_vulkan *vulkan);
void example_submit(const struct example_vulkan *vulkan, VkCommandBuffer commands); /* and waits */

/* What a kernel of rays.comp reads; the others are zero. */
struct example_scene {
    VkAccelerationStructureKHR structure;
    VkBuffer buffer;
    uint64_t root;
};

/* Runs it, and prints how many rays hit something, and how far they went together. */
void example_trace(const struct example_vulkan *vulkan, const uint32_t *code, size_t size,
                   const struct example_scene *scene);

#endif
