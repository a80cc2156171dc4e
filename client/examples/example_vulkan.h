/* SPDX-License-Identifier: Apache-2.0 */
/*
 * example_vulkan.h - what every Vulkan program has: a device, buffers, a kernel. None of it is specific to bvhd.
 * Failures end the program.
 */
#ifndef EXAMPLE_VULKAN_H
#define EXAMPLE_VULKAN_H

#include <vulkan/vulkan.h>

/* The features that a device must support: compute shaders, also buffer addresses, also ray queries. */
enum example_device { EXAMPLE_COMPUTE, EXAMPLE_ADDRESSES, EXAMPLE_RAY_QUERIES };

/* A device with one queue. */
struct example_vulkan {
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    uint32_t family;
    VkCommandPool pool;
    VkBool32 has_float64; /* the feature shaderFloat64 is enabled: wherever the device has it */
};

/* A buffer with its own memory. */
struct example_buffer {
    VkBuffer buffer;
    VkDeviceMemory memory;
    VkDeviceSize size;
    unsigned char *mapped; /* if the memory is host-visible */
    VkDeviceAddress address; /* with VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT */
};

/* Opens a device. Ends the program with status 77 if there is no such device. */
void example_open(struct example_vulkan *vulkan, enum example_device wanted);
void example_close(struct example_vulkan *vulkan);
/* Ends the program with the name of the call unless the result is VK_SUCCESS. */
void example_check(const char *what, VkResult result);

struct example_buffer example_buffer(const struct example_vulkan *vulkan, VkDeviceSize size, VkBufferUsageFlags usage,
                                     VkMemoryPropertyFlags properties);
void example_free(const struct example_vulkan *vulkan, struct example_buffer *buffer);

/* Starts recording into a new command buffer. */
VkCommandBuffer example_begin(const struct example_vulkan *vulkan);
void example_submit(const struct example_vulkan *vulkan, VkCommandBuffer commands); /* also waits */

/* The scene for a kernel of rays.comp, which uses one of the members; the others are zero. */
struct example_scene {
    VkAccelerationStructureKHR structure;
    VkBuffer buffer;
    uint64_t root;
};

/* Runs the kernel, and prints how many rays hit something and the sum of their distances. */
void example_trace(const struct example_vulkan *vulkan, const uint32_t *code, size_t size,
                   const struct example_scene *scene);

#endif
