/* SPDX-License-Identifier: Apache-2.0 */
/* vulkan_kernel.h - compute pipelines of the library: layouts, pipelines from SPIR-V, descriptor sets. */
#ifndef BVHD_VULKAN_KERNEL_H
#define BVHD_VULKAN_KERNEL_H

#include "client/vulkan/vulkan_device.h"

enum { VULKAN_MAX_BINDINGS = 32, VULKAN_MAX_CONSTANTS = 32 };

/*
 * The layout of pipelines and their descriptor sets: `buffers` storage buffers from binding 0 on, and after them
 * `structures` acceleration structures.
 */
struct vulkan_layout {
    VkDescriptorSetLayout set;
    VkPipelineLayout pipeline;
    uint32_t buffers, structures;
    uint32_t push_size; /* bytes of push constants; may be 0 */
};

/* BVHD_INTERNAL: no bindings, or more than VULKAN_MAX_BINDINGS. On failure nothing is held. */
enum bvhd_status vulkan_layout_create(const struct bvhd_vulkan_device *device, uint32_t buffers, uint32_t structures,
                                      uint32_t push_size, struct vulkan_layout *ret_layout, struct bvhd_error *error);
/* Idempotent; all zero is a layout that is not there. */
void vulkan_layout_destroy(const struct bvhd_vulkan_device *device, struct vulkan_layout *layout);

/* SPIR-V, and the values of specialisation constants 0 .. constant_count - 1. */
struct vulkan_code {
    const uint32_t *words;
    size_t size; /* bytes */
    const uint32_t *constants;
    uint32_t constant_count;
};

/* BVHD_INTERNAL: more constants than VULKAN_MAX_CONSTANTS. The caller ends it with vulkan_pipeline_destroy. */
enum bvhd_status vulkan_pipeline_create(const struct bvhd_vulkan_device *device, const struct vulkan_layout *layout,
                                        VkPipelineCache cache, const struct vulkan_code *code, VkPipeline *ret_pipeline,
                                        struct bvhd_error *error);
void vulkan_pipeline_destroy(const struct bvhd_vulkan_device *device, VkPipeline pipeline);

/* A descriptor set with a pool of its own. */
struct vulkan_set {
    VkDescriptorPool pool;
    VkDescriptorSet handle;
};

/* End it with vulkan_set_destroy. */
enum bvhd_status vulkan_set_create(const struct bvhd_vulkan_device *device, const struct vulkan_layout *layout,
                                   struct vulkan_set *ret_set, struct bvhd_error *error);
/* Idempotent; all zero is a set that is not there. */
void vulkan_set_destroy(const struct bvhd_vulkan_device *device, struct vulkan_set *set);
/*
 * Points the storage buffers at ranges[0 .. layout->buffers), of which those without a buffer are left as they are, and
 * the acceleration structures at structures[0 .. layout->structures). Of a range that is larger than a shader can bind,
 * only the beginning is bound; shaders must reach the rest by its address. The device must not be using the set.
 */
void vulkan_set_write(const struct bvhd_vulkan_device *device, const struct vulkan_layout *layout,
                      const struct vulkan_set *set, const VkDescriptorBufferInfo *ranges,
                      const VkAccelerationStructureKHR *structures);

/* Records the pipeline, the set, `push` (the layout's push_size bytes) and a dispatch of `groups` workgroups in x. */
void vulkan_record_dispatch(const struct bvhd_vulkan_device *device, VkCommandBuffer commands,
                            const struct vulkan_layout *layout, VkPipeline pipeline, const struct vulkan_set *set,
                            const void *push, uint32_t groups);

#endif
