/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fake_vulkan.h - a Vulkan device in plain memory, as far as the client library uses one: every call can be made to
 * fail, and whatever is left, or used against Vulkan's rules, shows. Device addresses are host addresses; commands run
 * when they are submitted; structures are deserialized as lavapipe does it.
 *
 * For test programs with one thread. After unit.h: rules that are broken end the test.
 */
#ifndef BVHD_TEST_FAKE_VULKAN_H
#define BVHD_TEST_FAKE_VULKAN_H

#include <stdbool.h>

#include <bvhd/bvhd_vulkan.h>

struct fake_vulkan {
    /* Set by the test, after fake_vulkan_reset. */
    int64_t fail_after; /* < 0: never; n >= 0: the call after n more successes fails, and all later ones succeed */
    VkResult failure; /* how; VK_ERROR_OUT_OF_DEVICE_MEMORY */
    const char *missing; /* a function that is not found, or NULL */
    uint64_t max_storage_range, max_allocation, max_buffer;
    uint64_t max_primitives, max_instances;
    uint64_t local_left; /* bytes of device-local memory */
    bool is_updated; /* the driver takes no structure that is older */

    /* What happened. */
    uint64_t live; /* objects */
    uint64_t calls; /* that can fail */
    uint64_t submissions, allocations, structures;
    uint64_t host_bytes; /* the most memory that was mapped at once */
    VkPipelineStageFlags barrier_stages; /* of the last barrier: what it waits for, */
    VkAccessFlags barrier_writes; /* and which writes become visible */
};

extern struct fake_vulkan fake_vulkan;

void fake_vulkan_reset(void);

/* For bvhd_vulkan_device_create; every object is created and destroyed with `allocator`. */
struct bvhd_vulkan_device_options fake_vulkan_options(bool has_structures, bool has_addresses,
                                                      const VkAllocationCallbacks *allocator);
struct bvhd_vulkan_queue fake_vulkan_queue(void);

/* Bytes of a buffer, to look at. */
unsigned char *fake_vulkan_bytes(VkBuffer buffer);
/* The address at which a structure lies, its bytes, and its size as created. */
unsigned char *fake_vulkan_structure(VkAccelerationStructureKHR structure, uint64_t *ret_size,
                                     VkAccelerationStructureTypeKHR *ret_type);

/* For tests that record by themselves: buffers with memory, and a command buffer that runs on fake_vulkan_submit. */
VkBuffer fake_vulkan_buffer(uint64_t size, VkBufferUsageFlags usage, bool is_mapped, void **ret_mapped);
void fake_vulkan_free_buffer(VkBuffer buffer);
VkCommandBuffer fake_vulkan_commands(void);
/* How many commands were recorded since the last submission. */
uint32_t fake_vulkan_recorded(void);
void fake_vulkan_submit(void);
void fake_vulkan_destroy_structure(VkAccelerationStructureKHR structure);

#endif
