/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/gpu/gpu.h"
#include "proto/base/status.h"

enum { MAX_SLOTS = 32, MAX_CONSTANTS = 32 };

static enum bvhd_status create_layouts(struct gpu *gpu, struct gpu_kernel *kernel, struct bvhd_error *error)
{
    VkDescriptorSetLayoutBinding slots[MAX_SLOTS];
    uint32_t count = kernel->bindings + kernel->structures;
    for (uint32_t i = 0; i < count; i++)
        slots[i] = (VkDescriptorSetLayoutBinding){
            .binding = i,
            .descriptorType = i < kernel->bindings ? VK_DESCRIPTOR_TYPE_STORAGE_BUFFER
                                                   : VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR,
            .descriptorCount = 1,
            .stageFlags = VK_SHADER_STAGE_COMPUTE_BIT,
        };
    const VkDescriptorSetLayoutCreateInfo set = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = count, .pBindings = slots};
    enum bvhd_status status =
        gpu_result("vkCreateDescriptorSetLayout",
                   gpu->vk.CreateDescriptorSetLayout(gpu->device, &set, NULL, &kernel->set_layout), error);
    if (status)
        return status;
    const VkPushConstantRange range = {VK_SHADER_STAGE_COMPUTE_BIT, 0, kernel->push_size};
    const VkPipelineLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
        .setLayoutCount = 1,
        .pSetLayouts = &kernel->set_layout,
        .pushConstantRangeCount = kernel->push_size ? 1 : 0,
        .pPushConstantRanges = &range,
    };
    return gpu_result("vkCreatePipelineLayout",
                      gpu->vk.CreatePipelineLayout(gpu->device, &layout, NULL, &kernel->layout), error);
}

static enum bvhd_status create_pipeline(struct gpu *gpu, const struct gpu_kernel_options *options,
                                        VkShaderModule module, struct gpu_kernel *kernel, struct bvhd_error *error)
{
    VkSpecializationMapEntry entries[MAX_CONSTANTS];
    for (uint32_t i = 0; i < options->constant_count; i++)
        entries[i] = (VkSpecializationMapEntry){i, (uint32_t)(i * sizeof(uint32_t)), sizeof(uint32_t)};
    const VkSpecializationInfo constants = {options->constant_count, entries,
                                            options->constant_count * sizeof(uint32_t), options->constants};
    const VkComputePipelineCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
        .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                  .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                  .module = module,
                  .pName = "main",
                  .pSpecializationInfo = options->constant_count ? &constants : NULL},
        .layout = kernel->layout,
    };
    return gpu_result("vkCreateComputePipelines",
                      gpu->vk.CreateComputePipelines(gpu->device, VK_NULL_HANDLE, 1, &info, NULL, &kernel->pipeline),
                      error);
}

static enum bvhd_status load_code(struct gpu *gpu, const struct gpu_kernel_options *options, struct gpu_kernel *kernel,
                                  struct bvhd_error *error)
{
    VkShaderModule module;
    const VkShaderModuleCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = options->size, .pCode = options->code};
    enum bvhd_status status =
        gpu_result("vkCreateShaderModule", gpu->vk.CreateShaderModule(gpu->device, &info, NULL, &module), error);
    if (status)
        return status;
    status = create_pipeline(gpu, options, module, kernel, error);
    gpu->vk.DestroyShaderModule(gpu->device, module, NULL);
    return status;
}

static enum bvhd_status create_set(struct gpu *gpu, struct gpu_kernel *kernel, struct bvhd_error *error)
{
    VkDescriptorPoolSize sizes[2];
    uint32_t kinds = 0;
    if (kernel->bindings)
        sizes[kinds++] = (VkDescriptorPoolSize){VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, kernel->bindings};
    if (kernel->structures)
        sizes[kinds++] = (VkDescriptorPoolSize){VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, kernel->structures};
    const VkDescriptorPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                             .maxSets = 1,
                                             .poolSizeCount = kinds,
                                             .pPoolSizes = sizes};
    enum bvhd_status status = gpu_result("vkCreateDescriptorPool",
                                         gpu->vk.CreateDescriptorPool(gpu->device, &pool, NULL, &kernel->pool), error);
    if (status)
        return status;
    const VkDescriptorSetAllocateInfo info = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
        .descriptorPool = kernel->pool,
        .descriptorSetCount = 1,
        .pSetLayouts = &kernel->set_layout,
    };
    return gpu_result("vkAllocateDescriptorSets", gpu->vk.AllocateDescriptorSets(gpu->device, &info, &kernel->set),
                      error);
}

enum bvhd_status gpu_kernel_create(struct gpu *gpu, const struct gpu_kernel_options *options,
                                   struct gpu_kernel *ret_kernel, struct bvhd_error *error)
{
    struct gpu_kernel kernel = {
        .bindings = options->bindings, .structures = options->structures, .push_size = options->push_size};
    uint32_t slots = options->bindings + options->structures;
    if (!slots || slots > MAX_SLOTS || options->constant_count > MAX_CONSTANTS)
        return bvhd_error_set(error, BVHD_INTERNAL, "kernel", "%u bindings and %u constants", slots,
                              options->constant_count);
    enum bvhd_status status = create_layouts(gpu, &kernel, error);
    if (!status)
        status = load_code(gpu, options, &kernel, error);
    if (!status)
        status = create_set(gpu, &kernel, error);
    if (status)
        gpu_kernel_destroy(gpu, &kernel);
    else
        *ret_kernel = kernel;
    return status;
}

void gpu_kernel_destroy(struct gpu *gpu, struct gpu_kernel *kernel)
{
    if (!gpu || !kernel)
        return;
    gpu->vk.DestroyDescriptorPool(gpu->device, kernel->pool, NULL);
    gpu->vk.DestroyPipeline(gpu->device, kernel->pipeline, NULL);
    gpu->vk.DestroyPipelineLayout(gpu->device, kernel->layout, NULL);
    gpu->vk.DestroyDescriptorSetLayout(gpu->device, kernel->set_layout, NULL);
    *kernel = (struct gpu_kernel){.bindings = 0};
}

void gpu_kernel_bind(struct gpu *gpu, struct gpu_kernel *kernel, const struct gpu_buffer *const *buffers,
                     const VkAccelerationStructureKHR *structures)
{
    VkWriteDescriptorSet writes[MAX_SLOTS];
    VkDescriptorBufferInfo ranges[MAX_SLOTS];
    VkWriteDescriptorSetAccelerationStructureKHR handles[MAX_SLOTS];
    uint32_t count = kernel->bindings + kernel->structures;
    for (uint32_t i = 0; i < count; i++) {
        writes[i] = (VkWriteDescriptorSet){.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                           .dstSet = kernel->set,
                                           .dstBinding = i,
                                           .descriptorCount = 1};
        if (i < kernel->bindings) {
            VkDeviceSize size = buffers[i]->size, most = gpu->properties.max_storage_range & ~UINT64_C(3);
            ranges[i] = (VkDescriptorBufferInfo){buffers[i]->buffer, 0, size < most ? size : most};
            writes[i].descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
            writes[i].pBufferInfo = &ranges[i];
        } else {
            handles[i] = (VkWriteDescriptorSetAccelerationStructureKHR){
                .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
                .accelerationStructureCount = 1,
                .pAccelerationStructures = &structures[i - kernel->bindings],
            };
            writes[i].descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR;
            writes[i].pNext = &handles[i];
        }
    }
    gpu->vk.UpdateDescriptorSets(gpu->device, count, writes, 0, NULL);
}

void gpu_kernel_record(struct gpu *gpu, const struct gpu_kernel *kernel, VkCommandBuffer commands, const void *push,
                       uint32_t groups)
{
    gpu->vk.CmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, kernel->pipeline);
    gpu->vk.CmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, kernel->layout, 0, 1, &kernel->set, 0,
                                  NULL);
    if (push)
        gpu->vk.CmdPushConstants(commands, kernel->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, kernel->push_size, push);
    gpu->vk.CmdDispatch(commands, groups, 1, 1);
}
