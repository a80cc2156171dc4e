/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fake_vulkan.h - a Vulkan device in plain memory, as far as the client library uses one. Every call can be made to
 * fail, and objects that are leaked or used against Vulkan's rules are detected. Device addresses are host addresses;
 * commands run when they are submitted; structures are deserialized as lavapipe does it.
 *
 * For test programs with one thread. Include it after unit.h: a broken rule ends the test.
 */
#ifndef BVHD_TEST_FAKE_VULKAN_H
#define BVHD_TEST_FAKE_VULKAN_H

#include <stdbool.h>

#include <bvhd/bvhd_vulkan.h>

struct fake_vulkan {
    /* Set by the test, after fake_vulkan_reset: */
    int64_t fail_after; /* < 0: never; n >= 0: the call after n further successes fails, and all later ones succeed */
    VkResult failure; /* the result of the failing call; VK_ERROR_OUT_OF_DEVICE_MEMORY after a reset */
    const char *missing; /* a function that is not found, or NULL */
    uint64_t max_storage_range, max_allocation, max_buffer;
    uint64_t max_primitives, max_instances;
    uint64_t local_left; /* bytes of device-local memory */
    bool is_updated; /* the driver refuses structures, as if they were made for an older version */
    uint32_t api_version;
    VkSubgroupFeatureFlags subgroup_operations; /* in compute shaders, of subgroups of 32 */

    /* Counted by the fake: */
    uint64_t live; /* objects that exist */
    uint64_t calls; /* calls that can fail */
    uint64_t submissions, allocations, structures;
    uint64_t host_bytes; /* the most memory that was mapped at once */
    VkPipelineStageFlags barrier_stages; /* the stages that the last barrier waited for */
    VkAccessFlags barrier_writes; /* and the writes that it made visible */
    uint32_t dispatch_count; /* recorded */
    struct {
        VkPipeline pipeline;
        uint32_t groups;
        uint32_t group_size; /* specialisation constant 0 of the pipeline */
    } dispatches[16]; /* the first of them */
};

extern struct fake_vulkan fake_vulkan;

void fake_vulkan_reset(void);

/* Returns options for bvhd_vulkan_device_create; every object must be created and destroyed with `allocator`. */
struct bvhd_vulkan_device_options fake_vulkan_options(bool has_structures, bool has_addresses,
                                                      const VkAllocationCallbacks *allocator);
struct bvhd_vulkan_queue fake_vulkan_queue(void);

/* Returns the bytes of a buffer, for the test to read. */
unsigned char *fake_vulkan_bytes(VkBuffer buffer);
/* Returns the bytes of a structure, its size as created, and its type. */
unsigned char *fake_vulkan_structure(VkAccelerationStructureKHR structure, uint64_t *ret_size,
                                     VkAccelerationStructureTypeKHR *ret_type);

/*
 * For tests that record commands themselves: buffers with memory, and a command buffer that runs on fake_vulkan_submit.
 */
VkBuffer fake_vulkan_buffer(uint64_t size, VkBufferUsageFlags usage, bool is_mapped, void **ret_mapped);
void fake_vulkan_free_buffer(VkBuffer buffer);
VkCommandBuffer fake_vulkan_commands(void);
/* Returns how many commands were recorded since the last submission. */
uint32_t fake_vulkan_recorded(void);
void fake_vulkan_submit(void);
void fake_vulkan_destroy_structure(VkAccelerationStructureKHR structure);

#endif
