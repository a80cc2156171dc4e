/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer_top.h"

/* The inputs and memory of a build, besides the structure itself. */
struct scaffold {
    struct gpu_buffer instance, scratch;
    VkAccelerationStructureGeometryKHR geometry;
    VkAccelerationStructureBuildGeometryInfoKHR info;
};

static enum bvhd_status put_instance(struct gpu *gpu, uint64_t address, struct scaffold *scaffold,
                                     struct bvhd_error *error)
{
    const VkBufferUsageFlags usage = VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR;
    const VkAccelerationStructureInstanceKHR instance = {
        .transform.matrix = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}},
        .mask = 0xff,
        .accelerationStructureReference = address,
    };
    enum bvhd_status status = gpu_buffer_create(gpu, sizeof instance, usage, GPU_UPLOAD, &scaffold->instance, error);
    if (status != BVHD_OK)
        return status;
    *(VkAccelerationStructureInstanceKHR *)scaffold->instance.mapped = instance;
    scaffold->geometry = (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
        .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                               .data.deviceAddress = scaffold->instance.address},
    };
    scaffold->info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
        .flags = VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR,
        .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .geometryCount = 1,
        .pGeometries = &scaffold->geometry,
    };
    return BVHD_OK;
}

static uint64_t scratch_alignment(struct gpu *gpu)
{
    VkPhysicalDeviceAccelerationStructurePropertiesKHR structures = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_PROPERTIES_KHR};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2,
                                              .pNext = &structures};
    gpu_properties(gpu, &properties);
    uint64_t alignment = structures.minAccelerationStructureScratchOffsetAlignment;
    return alignment ? alignment : 1;
}

static enum bvhd_status create(struct gpu *gpu, struct scaffold *scaffold, struct tracer_top *top,
                               struct bvhd_error *error)
{
    const uint32_t count = 1;
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    uint64_t alignment = scratch_alignment(gpu);
    gpu->vk.GetAccelerationStructureBuildSizesKHR(gpu->device, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR,
                                                  &scaffold->info, &count, &sizes);
    enum bvhd_status status =
        gpu_buffer_create(gpu, sizes.accelerationStructureSize, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR,
                          GPU_DEVICE, &top->storage, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(gpu, sizes.buildScratchSize + alignment, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
                                   GPU_DEVICE, &scaffold->scratch, error);
    if (status != BVHD_OK)
        return status;
    const VkAccelerationStructureCreateInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
        .buffer = top->storage.buffer,
        .size = sizes.accelerationStructureSize,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
    };
    scaffold->info.scratchData.deviceAddress = (scaffold->scratch.address + alignment - 1) / alignment * alignment;
    VkResult result = gpu->vk.CreateAccelerationStructureKHR(gpu->device, &info, NULL, &top->handle);
    scaffold->info.dstAccelerationStructure = top->handle;
    return gpu_result("vkCreateAccelerationStructureKHR", result, error);
}

static enum bvhd_status build(struct gpu *gpu, const struct scaffold *scaffold, struct bvhd_error *error)
{
    const VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = 1}, *ranges = &range;
    const VkMemoryBarrier built = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                   .srcAccessMask = VK_ACCESS_ACCELERATION_STRUCTURE_WRITE_BIT_KHR,
                                   .dstAccessMask = VK_ACCESS_ACCELERATION_STRUCTURE_READ_BIT_KHR};
    VkCommandBuffer commands;
    enum bvhd_status status = gpu_begin(gpu, &commands, error);
    if (status != BVHD_OK)
        return status;
    gpu->vk.CmdBuildAccelerationStructuresKHR(commands, 1, &scaffold->info, &ranges);
    /* To have waited is not enough for later submissions to see it. */
    gpu->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR,
                               VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, 0, 1, &built, 0, NULL, 0, NULL);
    return gpu_submit(gpu, commands, error);
}

enum bvhd_status tracer_top_build(struct gpu *gpu, uint64_t address, struct tracer_top *ret_top,
                                  struct bvhd_error *error)
{
    struct scaffold scaffold = {.scratch.size = 0};
    struct tracer_top top = {.handle = VK_NULL_HANDLE};
    enum bvhd_status status = put_instance(gpu, address, &scaffold, error);
    if (status == BVHD_OK)
        status = create(gpu, &scaffold, &top, error);
    if (status == BVHD_OK)
        status = build(gpu, &scaffold, error);
    gpu_buffer_destroy(gpu, &scaffold.instance);
    gpu_buffer_destroy(gpu, &scaffold.scratch);
    if (status != BVHD_OK)
        tracer_top_finish(gpu, &top);
    else
        *ret_top = top;
    return status;
}

void tracer_top_finish(struct gpu *gpu, struct tracer_top *top)
{
    if (!gpu || !top)
        return;
    if (top->handle)
        gpu->vk.DestroyAccelerationStructureKHR(gpu->device, top->handle, NULL);
    gpu_buffer_destroy(gpu, &top->storage);
    *top = (struct tracer_top){.handle = VK_NULL_HANDLE};
}
