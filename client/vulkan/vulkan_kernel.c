/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan/vulkan_kernel.h"

#include <string.h>

/* ---- layouts ---- */

static VkDescriptorType type_of(const struct vulkan_layout *layout, uint32_t binding)
{
    return binding < layout->buffers ? VK_DESCRIPTOR_TYPE_STORAGE_BUFFER
                                     : VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR;
}

static enum bvhd_status fill_layout(const struct bvhd_vulkan_device *device, struct vulkan_layout *layout,
                                    struct bvhd_error *error)
{
    VkDescriptorSetLayoutBinding bindings[VULKAN_MAX_BINDINGS];
    uint32_t count = layout->buffers + layout->structures;
    for (uint32_t i = 0; i < count; i++)
        bindings[i] = (VkDescriptorSetLayoutBinding){.binding = i,
                                                     .descriptorType = type_of(layout, i),
                                                     .descriptorCount = 1,
                                                     .stageFlags = VK_SHADER_STAGE_COMPUTE_BIT};
    const VkDescriptorSetLayoutCreateInfo set = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = count, .pBindings = bindings};
    VkResult result = device->vk.CreateDescriptorSetLayout(device->handle, &set, device->allocator, &layout->set);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkCreateDescriptorSetLayout", result, error);
    const VkPushConstantRange push = {VK_SHADER_STAGE_COMPUTE_BIT, 0, layout->push_size};
    const VkPipelineLayoutCreateInfo pipeline = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
        .setLayoutCount = 1,
        .pSetLayouts = &layout->set,
        .pushConstantRangeCount = layout->push_size ? 1 : 0,
        .pPushConstantRanges = &push,
    };
    result = device->vk.CreatePipelineLayout(device->handle, &pipeline, device->allocator, &layout->pipeline);
    return vulkan_device_result("vkCreatePipelineLayout", result, error);
}

enum bvhd_status vulkan_layout_create(const struct bvhd_vulkan_device *device, uint32_t buffers, uint32_t structures,
                                      uint32_t push_size, struct vulkan_layout *ret_layout, struct bvhd_error *error)
{
    struct vulkan_layout layout = {.buffers = buffers, .structures = structures, .push_size = push_size};
    if (buffers + structures == 0 || buffers + structures > VULKAN_MAX_BINDINGS)
        return bvhd_error_set(error, BVHD_INTERNAL, "kernel", "%u bindings", (unsigned)(buffers + structures));
    enum bvhd_status status = fill_layout(device, &layout, error);
    if (status == BVHD_OK)
        *ret_layout = layout;
    else
        vulkan_layout_destroy(device, &layout);
    return status;
}

void vulkan_layout_destroy(const struct bvhd_vulkan_device *device, struct vulkan_layout *layout)
{
    if (layout->pipeline)
        device->vk.DestroyPipelineLayout(device->handle, layout->pipeline, device->allocator);
    if (layout->set)
        device->vk.DestroyDescriptorSetLayout(device->handle, layout->set, device->allocator);
    memset(layout, 0, sizeof *layout);
}

/* ---- pipelines ---- */

static enum bvhd_status create_pipeline(const struct bvhd_vulkan_device *device, const struct vulkan_layout *layout,
                                        VkPipelineCache cache, const struct vulkan_code *code, VkShaderModule module,
                                        VkPipeline *ret_pipeline, struct bvhd_error *error)
{
    VkSpecializationMapEntry entries[VULKAN_MAX_CONSTANTS];
    VkPipeline pipeline = VK_NULL_HANDLE;
    for (uint32_t i = 0; i < code->constant_count; i++)
        entries[i] = (VkSpecializationMapEntry){i, (uint32_t)(i * sizeof(uint32_t)), sizeof(uint32_t)};
    const VkSpecializationInfo constants = {code->constant_count, entries, code->constant_count * sizeof(uint32_t),
                                            code->constants};
    const VkComputePipelineCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
        .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                  .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                  .module = module,
                  .pName = "main",
                  .pSpecializationInfo = code->constant_count ? &constants : NULL},
        .layout = layout->pipeline,
    };
    VkResult result = device->vk.CreateComputePipelines(device->handle, cache, 1, &info, device->allocator, &pipeline);
    if (result == VK_SUCCESS)
        *ret_pipeline = pipeline;
    return vulkan_device_result("vkCreateComputePipelines", result, error);
}

enum bvhd_status vulkan_pipeline_create(const struct bvhd_vulkan_device *device, const struct vulkan_layout *layout,
                                        VkPipelineCache cache, const struct vulkan_code *code, VkPipeline *ret_pipeline,
                                        struct bvhd_error *error)
{
    VkShaderModule module;
    const VkShaderModuleCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = code->size, .pCode = code->words};
    if (code->constant_count > VULKAN_MAX_CONSTANTS)
        return bvhd_error_set(error, BVHD_INTERNAL, "kernel", "%u constants", (unsigned)code->constant_count);
    VkResult result = device->vk.CreateShaderModule(device->handle, &info, device->allocator, &module);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkCreateShaderModule", result, error);
    enum bvhd_status status = create_pipeline(device, layout, cache, code, module, ret_pipeline, error);
    device->vk.DestroyShaderModule(device->handle, module, device->allocator);
    return status;
}

void vulkan_pipeline_destroy(const struct bvhd_vulkan_device *device, VkPipeline pipeline)
{
    if (pipeline)
        device->vk.DestroyPipeline(device->handle, pipeline, device->allocator);
}

/* ---- descriptor sets ---- */

enum bvhd_status vulkan_set_create(const struct bvhd_vulkan_device *device, const struct vulkan_layout *layout,
                                   struct vulkan_set *ret_set, struct bvhd_error *error)
{
    VkDescriptorPoolSize sizes[2];
    uint32_t kinds = 0;
    if (layout->buffers)
        sizes[kinds++] = (VkDescriptorPoolSize){VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, layout->buffers};
    if (layout->structures)
        sizes[kinds++] = (VkDescriptorPoolSize){VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, layout->structures};
    const VkDescriptorPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                             .maxSets = 1,
                                             .poolSizeCount = kinds,
                                             .pPoolSizes = sizes};
    struct vulkan_set set = {.pool = VK_NULL_HANDLE};
    VkResult result = device->vk.CreateDescriptorPool(device->handle, &pool, device->allocator, &set.pool);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkCreateDescriptorPool", result, error);
    const VkDescriptorSetAllocateInfo info = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
        .descriptorPool = set.pool,
        .descriptorSetCount = 1,
        .pSetLayouts = &layout->set,
    };
    result = device->vk.AllocateDescriptorSets(device->handle, &info, &set.handle);
    if (result == VK_SUCCESS)
        *ret_set = set;
    else
        vulkan_set_destroy(device, &set);
    return vulkan_device_result("vkAllocateDescriptorSets", result, error);
}

void vulkan_set_destroy(const struct bvhd_vulkan_device *device, struct vulkan_set *set)
{
    if (set->pool)
        device->vk.DestroyDescriptorPool(device->handle, set->pool, device->allocator);
    memset(set, 0, sizeof *set);
}

void vulkan_set_write(const struct bvhd_vulkan_device *device, const struct vulkan_layout *layout,
                      const struct vulkan_set *set, const VkDescriptorBufferInfo *ranges,
                      const VkAccelerationStructureKHR *structures)
{
    VkWriteDescriptorSet writes[VULKAN_MAX_BINDINGS];
    VkDescriptorBufferInfo bound[VULKAN_MAX_BINDINGS];
    VkWriteDescriptorSetAccelerationStructureKHR handles[VULKAN_MAX_BINDINGS];
    VkDeviceSize most = device->limits.storage_range & ~UINT64_C(3);
    uint32_t count = 0;
    for (uint32_t i = 0; i < layout->buffers + layout->structures; i++) {
        VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                      .dstSet = set->handle,
                                      .dstBinding = i,
                                      .descriptorCount = 1,
                                      .descriptorType = type_of(layout, i)};
        if (i >= layout->buffers) {
            handles[i] = (VkWriteDescriptorSetAccelerationStructureKHR){
                .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
                .accelerationStructureCount = 1,
                .pAccelerationStructures = &structures[i - layout->buffers],
            };
            write.pNext = &handles[i];
        } else if (ranges[i].buffer) {
            bound[i] = ranges[i];
            bound[i].range = bound[i].range < most ? bound[i].range : most;
            write.pBufferInfo = &bound[i];
        } else
            continue;
        writes[count++] = write;
    }
    device->vk.UpdateDescriptorSets(device->handle, count, writes, 0, NULL);
}

void vulkan_record_dispatch(const struct bvhd_vulkan_device *device, VkCommandBuffer commands,
                            const struct vulkan_layout *layout, VkPipeline pipeline, const struct vulkan_set *set,
                            const void *push, uint32_t groups)
{
    device->vk.CmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
    device->vk.CmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, layout->pipeline, 0, 1, &set->handle, 0,
                                     NULL);
    if (layout->push_size)
        device->vk.CmdPushConstants(commands, layout->pipeline, VK_SHADER_STAGE_COMPUTE_BIT, 0, layout->push_size,
                                    push);
    device->vk.CmdDispatch(commands, groups, 1, 1);
}
