/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/driver/ray_pipeline.h"

#include <string.h>

#include "client/bvhctl/trace/device_ray.h"
#include "tests/support/rays_aabb_rchit.h"
#include "tests/support/rays_rahit.h"
#include "tests/support/rays_rgen.h"
#include "tests/support/rays_rint.h"
#include "tests/support/rays_rmiss.h"
#include "tests/support/rays_triangle_rchit.h"

enum { MAX_RAYS = 1 << 22 }; /* of a launch, if the device can bind that many */

enum { STAGE_GENERATION, STAGE_MISS, STAGE_TRIANGLE, STAGE_ANY, STAGE_BOX, STAGE_INTERSECTION, STAGES };

/*
 * Each group has its own record in the shader binding table. Hit records have stride 0, so that one of them serves
 * every geometry, whatever the offset of an instance.
 */
enum { GROUP_GENERATION, GROUP_MISS, GROUP_TRIANGLES, GROUP_BOXES, GROUPS };

enum { BINDING_TOP, BINDING_RAYS, BINDING_HITS, BINDING_BOXES, BINDING_FIRST, BINDINGS };

enum { PASS_ALL, PASS_TRIANGLES, PASS_BOXES };

struct ray_pipeline {
    struct tracer tracer;
    struct gpu *gpu;
    struct memory *memory;
    VkAccelerationStructureKHR top;
    VkDescriptorSetLayout set_layout;
    VkPipelineLayout layout;
    VkPipeline pipeline;
    VkDescriptorPool pool;
    VkDescriptorSet set;
    VkQueryPool clock;
    struct gpu_buffer table, rays, hits, upload, readback, boxes, first;
    uint32_t record_size; /* distance between two records of the table */
    uint64_t table_address, most_rays; /* of a launch */
    bool has_boxes;
};

static const struct {
    const uint32_t *code;
    size_t size;
    VkShaderStageFlagBits stage;
} shaders[STAGES] = {
    [STAGE_GENERATION] = {rays_rgen, sizeof rays_rgen, VK_SHADER_STAGE_RAYGEN_BIT_KHR},
    [STAGE_MISS] = {rays_rmiss, sizeof rays_rmiss, VK_SHADER_STAGE_MISS_BIT_KHR},
    [STAGE_TRIANGLE] = {rays_triangle_rchit, sizeof rays_triangle_rchit, VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR},
    [STAGE_ANY] = {rays_rahit, sizeof rays_rahit, VK_SHADER_STAGE_ANY_HIT_BIT_KHR},
    [STAGE_BOX] = {rays_aabb_rchit, sizeof rays_aabb_rchit, VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR},
    [STAGE_INTERSECTION] = {rays_rint, sizeof rays_rint, VK_SHADER_STAGE_INTERSECTION_BIT_KHR},
};

/* ---- Creating ---- */

static enum bvhd_status create_layout(struct ray_pipeline *self, struct bvhd_error *error)
{
    struct gpu *gpu = self->gpu;
    VkDescriptorSetLayoutBinding bindings[BINDINGS];
    for (uint32_t i = 0; i < BINDINGS; i++)
        bindings[i] = (VkDescriptorSetLayoutBinding){
            .binding = i,
            .descriptorType =
                i == BINDING_TOP ? VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR : VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
            .descriptorCount = 1,
            .stageFlags = VK_SHADER_STAGE_RAYGEN_BIT_KHR | VK_SHADER_STAGE_INTERSECTION_BIT_KHR};
    VkDescriptorSetLayoutCreateInfo set = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = BINDINGS, .pBindings = bindings};
    VkPushConstantRange push = {VK_SHADER_STAGE_RAYGEN_BIT_KHR, 0, sizeof(uint32_t)};
    VkPipelineLayoutCreateInfo layout = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                         .setLayoutCount = 1,
                                         .pSetLayouts = &self->set_layout,
                                         .pushConstantRangeCount = 1,
                                         .pPushConstantRanges = &push};
    enum bvhd_status status =
        gpu_result("vkCreateDescriptorSetLayout",
                   gpu->vk.CreateDescriptorSetLayout(gpu->device, &set, NULL, &self->set_layout), error);
    if (status != BVHD_OK)
        return status;
    return gpu_result("vkCreatePipelineLayout", gpu->vk.CreatePipelineLayout(gpu->device, &layout, NULL, &self->layout),
                      error);
}

static enum bvhd_status create_set(struct ray_pipeline *self, struct bvhd_error *error)
{
    struct gpu *gpu = self->gpu;
    VkDescriptorPoolSize sizes[2] = {{VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1},
                                     {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, BINDINGS - 1}};
    VkDescriptorPoolCreateInfo pool = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 2, .pPoolSizes = sizes};
    enum bvhd_status status = gpu_result("vkCreateDescriptorPool",
                                         gpu->vk.CreateDescriptorPool(gpu->device, &pool, NULL, &self->pool), error);
    if (status != BVHD_OK)
        return status;
    VkDescriptorSetAllocateInfo set = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                       .descriptorPool = self->pool,
                                       .descriptorSetCount = 1,
                                       .pSetLayouts = &self->set_layout};
    return gpu_result("vkAllocateDescriptorSets", gpu->vk.AllocateDescriptorSets(gpu->device, &set, &self->set), error);
}

static VkRayTracingShaderGroupCreateInfoKHR general_group(uint32_t stage)
{
    return (VkRayTracingShaderGroupCreateInfoKHR){.sType = VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR,
                                                  .type = VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR,
                                                  .generalShader = stage,
                                                  .closestHitShader = VK_SHADER_UNUSED_KHR,
                                                  .anyHitShader = VK_SHADER_UNUSED_KHR,
                                                  .intersectionShader = VK_SHADER_UNUSED_KHR};
}

static VkRayTracingShaderGroupCreateInfoKHR hit_group(VkRayTracingShaderGroupTypeKHR type, uint32_t closest,
                                                      uint32_t intersection)
{
    VkRayTracingShaderGroupCreateInfoKHR group = general_group(VK_SHADER_UNUSED_KHR);
    group.type = type;
    group.closestHitShader = closest;
    group.anyHitShader = STAGE_ANY;
    group.intersectionShader = intersection;
    return group;
}

static enum bvhd_status create_from_stages(struct ray_pipeline *self, const VkPipelineShaderStageCreateInfo *stages,
                                           struct bvhd_error *error)
{
    struct gpu *gpu = self->gpu;
    VkRayTracingShaderGroupCreateInfoKHR groups[GROUPS] = {
        [GROUP_GENERATION] = general_group(STAGE_GENERATION),
        [GROUP_MISS] = general_group(STAGE_MISS),
        [GROUP_TRIANGLES] =
            hit_group(VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR, STAGE_TRIANGLE, VK_SHADER_UNUSED_KHR),
        [GROUP_BOXES] =
            hit_group(VK_RAY_TRACING_SHADER_GROUP_TYPE_PROCEDURAL_HIT_GROUP_KHR, STAGE_BOX, STAGE_INTERSECTION)};
    VkRayTracingPipelineCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR,
                                              .stageCount = STAGES,
                                              .pStages = stages,
                                              .groupCount = GROUPS,
                                              .pGroups = groups,
                                              .maxPipelineRayRecursionDepth = 1,
                                              .layout = self->layout};
    return gpu_result("vkCreateRayTracingPipelinesKHR",
                      gpu->vk.CreateRayTracingPipelinesKHR(gpu->device, VK_NULL_HANDLE, VK_NULL_HANDLE, 1, &info, NULL,
                                                           &self->pipeline),
                      error);
}

static enum bvhd_status create_pipeline(struct ray_pipeline *self, struct bvhd_error *error)
{
    struct gpu *gpu = self->gpu;
    VkPipelineShaderStageCreateInfo stages[STAGES] = {0};
    enum bvhd_status status = BVHD_OK;
    for (int i = 0; i < STAGES && status == BVHD_OK; i++) {
        VkShaderModuleCreateInfo info = {.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                         .codeSize = shaders[i].size,
                                         .pCode = shaders[i].code};
        stages[i] = (VkPipelineShaderStageCreateInfo){
            .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO, .stage = shaders[i].stage, .pName = "main"};
        status = gpu_result("vkCreateShaderModule",
                            gpu->vk.CreateShaderModule(gpu->device, &info, NULL, &stages[i].module), error);
    }
    if (status == BVHD_OK)
        status = create_from_stages(self, stages, error);
    for (int i = 0; i < STAGES; i++)
        if (stages[i].module)
            gpu->vk.DestroyShaderModule(gpu->device, stages[i].module, NULL);
    return status;
}

static VkPhysicalDeviceRayTracingPipelinePropertiesKHR pipeline_properties(const struct gpu *gpu)
{
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR properties = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR};
    VkPhysicalDeviceProperties2 all = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &properties};
    PFN_vkVoidFunction function = gpu->get_instance_proc_addr(gpu->instance, "vkGetPhysicalDeviceProperties2");
    ((PFN_vkGetPhysicalDeviceProperties2)function)(gpu->physical, &all);
    return properties;
}

/* Creates the shader binding table, with one record for each group. */
static enum bvhd_status create_table(struct ray_pipeline *self, struct bvhd_error *error)
{
    struct gpu *gpu = self->gpu;
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR limits = pipeline_properties(gpu);
    uint32_t size = limits.shaderGroupHandleSize, base = limits.shaderGroupBaseAlignment;
    unsigned char *handles = memory_array(self->memory, GROUPS, size);
    if (!handles)
        return bvhd_error_no_memory(error, "ray pipeline", "no memory for its handles");
    self->record_size = (size + base - 1) / base * base;
    enum bvhd_status status = gpu_result("vkGetRayTracingShaderGroupHandlesKHR",
                                         gpu->vk.GetRayTracingShaderGroupHandlesKHR(
                                             gpu->device, self->pipeline, 0, GROUPS, (size_t)GROUPS * size, handles),
                                         error);
    if (status == BVHD_OK)
        status =
            gpu_buffer_create(gpu, (VkDeviceSize)GROUPS * self->record_size + base,
                              VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT,
                              GPU_UPLOAD, &self->table, error);
    if (status == BVHD_OK) {
        self->table_address = (self->table.address + base - 1) / base * base;
        for (uint32_t i = 0; i < GROUPS; i++)
            memcpy((unsigned char *)self->table.mapped + (self->table_address - self->table.address) +
                       (size_t)i * self->record_size,
                   handles + (size_t)i * size, size);
    }
    memory_free(self->memory, handles);
    return status;
}

static enum bvhd_status create_buffers(struct ray_pipeline *self, struct bvhd_error *error)
{
    struct gpu *gpu = self->gpu;
    const VkBufferUsageFlags storage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
    VkDeviceSize rays = self->most_rays * sizeof(struct bvhd_ray), hits = self->most_rays * sizeof(struct tracer_hit);
    VkQueryPoolCreateInfo clock = {
        .sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO, .queryType = VK_QUERY_TYPE_TIMESTAMP, .queryCount = 2};
    enum bvhd_status status =
        gpu_buffer_create(gpu, rays, storage | VK_BUFFER_USAGE_TRANSFER_DST_BIT, GPU_DEVICE, &self->rays, error);
    if (status == BVHD_OK)
        status =
            gpu_buffer_create(gpu, hits, storage | VK_BUFFER_USAGE_TRANSFER_SRC_BIT, GPU_DEVICE, &self->hits, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(gpu, rays, VK_BUFFER_USAGE_TRANSFER_SRC_BIT, GPU_UPLOAD, &self->upload, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(gpu, hits, VK_BUFFER_USAGE_TRANSFER_DST_BIT, GPU_READBACK, &self->readback, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(gpu, 6 * sizeof(float), storage, GPU_UPLOAD, &self->boxes, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(gpu, 2 * sizeof(uint32_t), storage, GPU_UPLOAD, &self->first, error);
    if (status == BVHD_OK)
        status =
            gpu_result("vkCreateQueryPool", gpu->vk.CreateQueryPool(gpu->device, &clock, NULL, &self->clock), error);
    return status;
}

static void bind(struct ray_pipeline *self)
{
    const struct gpu_buffer *buffers[BINDINGS] = {NULL, &self->rays, &self->hits, &self->boxes, &self->first};
    VkWriteDescriptorSetAccelerationStructureKHR top = {
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = 1,
        .pAccelerationStructures = &self->top};
    VkDescriptorBufferInfo infos[BINDINGS];
    VkWriteDescriptorSet writes[BINDINGS];
    for (uint32_t i = 0; i < BINDINGS; i++) {
        writes[i] = (VkWriteDescriptorSet){.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                           .dstSet = self->set,
                                           .dstBinding = i,
                                           .descriptorCount = 1};
        if (i == BINDING_TOP) {
            writes[i].descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR;
            writes[i].pNext = &top;
            continue;
        }
        infos[i] = (VkDescriptorBufferInfo){buffers[i]->buffer, 0, VK_WHOLE_SIZE};
        writes[i].descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
        writes[i].pBufferInfo = &infos[i];
    }
    self->gpu->vk.UpdateDescriptorSets(self->gpu->device, BINDINGS, writes, 0, NULL);
}

/* ---- Tracing ---- */

static void barrier(struct ray_pipeline *self, VkCommandBuffer commands)
{
    VkMemoryBarrier memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                              .srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT,
                              .dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT};
    VkPipelineStageFlags stages =
        VK_PIPELINE_STAGE_TRANSFER_BIT | VK_PIPELINE_STAGE_RAY_TRACING_SHADER_BIT_KHR | VK_PIPELINE_STAGE_HOST_BIT;
    self->gpu->vk.CmdPipelineBarrier(commands, stages, stages, 0, 1, &memory, 0, NULL, 0, NULL);
}

static void launch(struct ray_pipeline *self, VkCommandBuffer commands, uint32_t count, uint32_t pass)
{
    VkDeviceSize step = self->record_size;
    VkStridedDeviceAddressRegionKHR generation = {self->table_address + GROUP_GENERATION * step, step, step};
    VkStridedDeviceAddressRegionKHR miss = {self->table_address + GROUP_MISS * step, step, step};
    VkStridedDeviceAddressRegionKHR hit = {
        self->table_address + (pass == PASS_BOXES ? GROUP_BOXES : GROUP_TRIANGLES) * step, 0, step};
    VkStridedDeviceAddressRegionKHR callable = {0};
    self->gpu->vk.CmdPushConstants(commands, self->layout, VK_SHADER_STAGE_RAYGEN_BIT_KHR, 0, sizeof pass, &pass);
    self->gpu->vk.CmdTraceRaysKHR(commands, &generation, &miss, &hit, &callable, count, 1, 1);
}

static void record(struct ray_pipeline *self, VkCommandBuffer commands, uint32_t count)
{
    struct gpu *gpu = self->gpu;
    VkBufferCopy rays = {0, 0, count * sizeof(struct bvhd_ray)}, hits = {0, 0, count * sizeof(struct tracer_hit)};
    gpu->vk.CmdResetQueryPool(commands, self->clock, 0, 2);
    gpu->vk.CmdCopyBuffer(commands, self->upload.buffer, self->rays.buffer, 1, &rays);
    barrier(self, commands);
    gpu->vk.CmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, self->pipeline);
    gpu->vk.CmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, self->layout, 0, 1, &self->set, 0,
                                  NULL);
    gpu->vk.CmdWriteTimestamp(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, self->clock, 0);
    launch(self, commands, count, self->has_boxes ? PASS_TRIANGLES : PASS_ALL);
    if (self->has_boxes) {
        barrier(self, commands);
        launch(self, commands, count, PASS_BOXES);
    }
    gpu->vk.CmdWriteTimestamp(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, self->clock, 1);
    barrier(self, commands);
    gpu->vk.CmdCopyBuffer(commands, self->hits.buffer, self->readback.buffer, 1, &hits);
    barrier(self, commands);
}

static enum bvhd_status trace_chunk(struct ray_pipeline *self, const struct ray *rays, uint32_t count,
                                    struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    struct gpu *gpu = self->gpu;
    uint64_t ticks[2];
    VkCommandBuffer commands;
    device_rays_put(rays, count, self->upload.mapped);
    enum bvhd_status status = gpu_begin(gpu, &commands, error);
    if (status != BVHD_OK)
        return status;
    record(self, commands, count);
    status = gpu_submit(gpu, commands, error);
    if (status == BVHD_OK)
        status =
            gpu_result("vkGetQueryPoolResults",
                       gpu->vk.GetQueryPoolResults(gpu->device, self->clock, 0, 2, sizeof ticks, ticks, sizeof ticks[0],
                                                   VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
                       error);
    if (status != BVHD_OK)
        return status;
    memcpy(ret_hits, self->readback.mapped, count * sizeof *ret_hits);
    *ret_seconds += (double)(ticks[1] - ticks[0]) * gpu->timestamp_ms * 1e-3;
    return BVHD_OK;
}

static enum bvhd_status trace(struct tracer *tracer, const struct ray *rays, uint64_t count,
                              struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    struct ray_pipeline *self = (struct ray_pipeline *)tracer;
    double seconds = 0;
    for (uint64_t done = 0; done < count; done += self->most_rays) {
        uint32_t some = (uint32_t)(count - done < self->most_rays ? count - done : self->most_rays);
        enum bvhd_status status = trace_chunk(self, rays + done, some, ret_hits + done, &seconds, error);
        if (status != BVHD_OK)
            return status;
    }
    if (ret_seconds)
        *ret_seconds = seconds;
    return BVHD_OK;
}

static void destroy(struct tracer *tracer)
{
    struct ray_pipeline *self = (struct ray_pipeline *)tracer;
    struct gpu *gpu = self->gpu;
    struct gpu_buffer *buffers[] = {&self->table,    &self->rays,  &self->hits, &self->upload,
                                    &self->readback, &self->boxes, &self->first};
    for (size_t i = 0; i < sizeof buffers / sizeof *buffers; i++)
        gpu_buffer_destroy(gpu, buffers[i]);
    if (self->clock)
        gpu->vk.DestroyQueryPool(gpu->device, self->clock, NULL);
    if (self->pool)
        gpu->vk.DestroyDescriptorPool(gpu->device, self->pool, NULL);
    if (self->pipeline)
        gpu->vk.DestroyPipeline(gpu->device, self->pipeline, NULL);
    if (self->layout)
        gpu->vk.DestroyPipelineLayout(gpu->device, self->layout, NULL);
    if (self->set_layout)
        gpu->vk.DestroyDescriptorSetLayout(gpu->device, self->set_layout, NULL);
    memory_free(self->memory, self);
}

enum bvhd_status ray_pipeline_create(struct gpu *gpu, VkAccelerationStructureKHR top, struct memory *memory,
                                     struct tracer **ret_tracer, struct bvhd_error *error)
{
    if (!gpu->properties.has_ray_pipeline)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, gpu->properties.name, "the device has no ray-tracing pipelines");
    struct ray_pipeline *self = memory_alloc(memory, sizeof *self);
    if (!self)
        return bvhd_error_no_memory(error, "ray pipeline", "no memory");
    *self = (struct ray_pipeline){.tracer = {.device = gpu->properties.name, .trace = trace, .destroy = destroy},
                                  .gpu = gpu,
                                  .memory = memory,
                                  .top = top};
    self->most_rays = gpu->properties.max_storage_range / sizeof(struct bvhd_ray);
    if (self->most_rays > MAX_RAYS)
        self->most_rays = MAX_RAYS;
    enum bvhd_status status = create_layout(self, error);
    if (status == BVHD_OK)
        status = create_set(self, error);
    if (status == BVHD_OK)
        status = create_pipeline(self, error);
    if (status == BVHD_OK)
        status = create_table(self, error);
    if (status == BVHD_OK)
        status = create_buffers(self, error);
    if (status != BVHD_OK) {
        destroy(&self->tracer);
        return status;
    }
    bind(self);
    *ret_tracer = &self->tracer;
    return BVHD_OK;
}

enum bvhd_status ray_pipeline_set_boxes(struct tracer *tracer, const struct scene_boxes *boxes,
                                        struct bvhd_error *error)
{
    struct ray_pipeline *self = (struct ray_pipeline *)tracer;
    struct gpu_buffer bounds = {0}, first = {0};
    size_t rows = (size_t)boxes->instance_count * boxes->geometry_stride;
    enum bvhd_status status = gpu_buffer_create(self->gpu, (VkDeviceSize)(boxes->box_count + 1) * 6 * sizeof(float),
                                                VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, GPU_UPLOAD, &bounds, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(self->gpu, (rows + 1) * sizeof(uint32_t), VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
                                   GPU_UPLOAD, &first, error);
    if (status != BVHD_OK) {
        gpu_buffer_destroy(self->gpu, &bounds);
        return status;
    }
    memcpy(bounds.mapped, boxes->boxes, (size_t)boxes->box_count * 6 * sizeof(float));
    ((uint32_t *)first.mapped)[0] = boxes->geometry_stride;
    memcpy((uint32_t *)first.mapped + 1, boxes->first, rows * sizeof(uint32_t));
    gpu_buffer_destroy(self->gpu, &self->boxes);
    gpu_buffer_destroy(self->gpu, &self->first);
    self->boxes = bounds;
    self->first = first;
    self->has_boxes = true;
    bind(self);
    return BVHD_OK;
}
