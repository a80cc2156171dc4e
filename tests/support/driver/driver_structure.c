/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/driver/driver_structure.h"

#include <string.h>

#include "builder/format/serialized.h"

/*
 * The largest alignment that Vulkan lets a device require: of scratch memory
 * (minAccelerationStructureScratchOffsetAlignment) and of serialized structures.
 */
enum { ALIGNMENT = 256 };

enum { INSTANCE_SIZE = 64, INSTANCE_REFERENCE = 56, AABB_SIZE = 24 };

/* The state of one build. */
struct driver_build {
    struct gpu *gpu;
    struct memory *memory;
    struct gpu_buffer input, scratch;
    VkAccelerationStructureBuildGeometryInfoKHR info;
    VkAccelerationStructureGeometryKHR *geometries;
    VkAccelerationStructureBuildRangeInfoKHR *ranges;
    uint32_t *counts;
    uint64_t scratch_size;
};

static uint64_t aligned(uint64_t address)
{
    return (address + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
}

/* Submits the commands with a barrier, so that later submissions see their results. */
static enum bvhd_status submit(struct gpu *gpu, VkCommandBuffer commands, struct bvhd_error *error)
{
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                               .srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT,
                               .dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT};
    gpu->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, 0, 1,
                               &barrier, 0, NULL, 0, NULL);
    return gpu_submit(gpu, commands, error);
}

/* Creates an empty structure of `size` bytes with its own storage. */
static enum bvhd_status create(struct gpu *gpu, VkAccelerationStructureTypeKHR type, uint64_t size,
                               struct driver_structure *ret_structure, struct bvhd_error *error)
{
    struct driver_structure structure = {.type = type, .size = size};
    enum bvhd_status status = gpu_buffer_create(
        gpu, size, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT,
        GPU_DEVICE, &structure.storage, error);
    if (status != BVHD_OK)
        return status;
    VkAccelerationStructureCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                 .buffer = structure.storage.buffer,
                                                 .size = size,
                                                 .type = type};
    status = gpu_result("vkCreateAccelerationStructureKHR",
                        gpu->vk.CreateAccelerationStructureKHR(gpu->device, &info, NULL, &structure.handle), error);
    if (status != BVHD_OK) {
        gpu_buffer_destroy(gpu, &structure.storage);
        return status;
    }
    VkAccelerationStructureDeviceAddressInfoKHR address = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
        .accelerationStructure = structure.handle};
    structure.address = gpu->vk.GetAccelerationStructureDeviceAddressKHR(gpu->device, &address);
    *ret_structure = structure;
    return BVHD_OK;
}

void driver_structure_destroy(struct gpu *gpu, struct driver_structure *structure)
{
    if (!structure)
        return;
    if (structure->handle)
        gpu->vk.DestroyAccelerationStructureKHR(gpu->device, structure->handle, NULL);
    gpu_buffer_destroy(gpu, &structure->storage);
    *structure = (struct driver_structure){0};
}

/* ---- Building ---- */

/* Replaces the rows of the reference table, 1-based, by addresses; 0 remains an inactive instance. */
static void patch_references(unsigned char *instances, uint32_t count, const uint64_t *references)
{
    for (uint32_t i = 0; i < count; i++) {
        unsigned char *field = instances + (size_t)i * INSTANCE_SIZE + INSTANCE_REFERENCE;
        uint64_t row;
        memcpy(&row, field, sizeof row);
        uint64_t address = row ? references[row - 1] : 0;
        memcpy(field, &address, sizeof address);
    }
}

static uint64_t input_address(const struct driver_build *build, const struct canonical *canonical, const void *data)
{
    return data ? build->input.address + (uint64_t)((const unsigned char *)data - canonical->bytes) : 0;
}

/* Uploads the canonical copy unchanged; the driver reads the arrays in it. */
static enum bvhd_status upload_input(struct driver_build *build, const struct canonical *canonical,
                                     const uint64_t *references, struct bvhd_error *error)
{
    enum bvhd_status status = gpu_buffer_create(build->gpu, canonical->size,
                                                VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                                                    VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT,
                                                GPU_UPLOAD, &build->input, error);
    if (status != BVHD_OK)
        return status;
    memcpy(build->input.mapped, canonical->bytes, canonical->size);
    for (uint32_t i = 0; i < canonical->geometry_count; i++) {
        const struct canonical_geometry *geometry = &canonical->geometries[i];
        if (geometry->instances)
            patch_references((unsigned char *)build->input.mapped + (geometry->instances - canonical->bytes),
                             geometry->primitive_count, references);
    }
    return BVHD_OK;
}

static VkAccelerationStructureGeometryKHR describe_geometry(const struct driver_build *build,
                                                            const struct canonical *canonical,
                                                            const struct canonical_geometry *geometry)
{
    VkAccelerationStructureGeometryKHR info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                                               .geometryType = (VkGeometryTypeKHR)geometry->type,
                                               .flags = geometry->flags};
    if (geometry->type == GEOMETRY_TRIANGLES)
        info.geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
            .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
            .vertexData.deviceAddress = input_address(build, canonical, geometry->positions),
            .vertexStride = 3 * sizeof(float),
            .maxVertex = geometry->vertex_count ? geometry->vertex_count - 1 : 0,
            .indexType = geometry->indices ? VK_INDEX_TYPE_UINT32 : VK_INDEX_TYPE_NONE_KHR,
            .indexData.deviceAddress = input_address(build, canonical, geometry->indices)};
    else if (geometry->type == GEOMETRY_AABBS)
        info.geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
            .data.deviceAddress = input_address(build, canonical, geometry->boxes),
            .stride = AABB_SIZE};
    else
        info.geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
            .data.deviceAddress = input_address(build, canonical, geometry->instances)};
    return info;
}

static enum bvhd_status describe(struct driver_build *build, const struct canonical *canonical,
                                 struct bvhd_error *error)
{
    uint32_t count = canonical->geometry_count;
    build->geometries = memory_array(build->memory, count + 1, sizeof *build->geometries);
    build->ranges = memory_array(build->memory, count + 1, sizeof *build->ranges);
    build->counts = memory_array(build->memory, count + 1, sizeof *build->counts);
    if (!build->geometries || !build->ranges || !build->counts)
        return bvhd_error_no_memory(error, "driver build", "no memory for the geometries");
    for (uint32_t i = 0; i < count; i++) {
        build->geometries[i] = describe_geometry(build, canonical, &canonical->geometries[i]);
        build->counts[i] = canonical->geometries[i].primitive_count;
        build->ranges[i] = (VkAccelerationStructureBuildRangeInfoKHR){.primitiveCount = build->counts[i]};
    }
    build->info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = canonical->type == STRUCTURE_TOP ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                                 : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
        .flags = canonical->flags,
        .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .geometryCount = count,
        .pGeometries = build->geometries};
    return BVHD_OK;
}

static enum bvhd_status submit_build(struct driver_build *build, struct bvhd_error *error)
{
    struct gpu *gpu = build->gpu;
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = build->ranges;
    VkCommandBuffer commands;
    enum bvhd_status status =
        gpu_buffer_create(gpu, build->scratch_size + ALIGNMENT,
                          VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT, GPU_DEVICE,
                          &build->scratch, error);
    if (status == BVHD_OK)
        status = gpu_begin(gpu, &commands, error);
    if (status != BVHD_OK)
        return status;
    build->info.scratchData.deviceAddress = aligned(build->scratch.address);
    gpu->vk.CmdBuildAccelerationStructuresKHR(commands, 1, &build->info, &ranges);
    return submit(gpu, commands, error);
}

static enum bvhd_status build_described(struct driver_build *build, struct driver_structure *ret_structure,
                                        struct bvhd_error *error)
{
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    build->gpu->vk.GetAccelerationStructureBuildSizesKHR(
        build->gpu->device, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR, &build->info, build->counts, &sizes);
    build->scratch_size = sizes.buildScratchSize;
    struct driver_structure structure;
    enum bvhd_status status = create(build->gpu, build->info.type, sizes.accelerationStructureSize, &structure, error);
    if (status != BVHD_OK)
        return status;
    build->info.dstAccelerationStructure = structure.handle;
    status = submit_build(build, error);
    if (status != BVHD_OK) {
        driver_structure_destroy(build->gpu, &structure);
        return status;
    }
    *ret_structure = structure;
    return BVHD_OK;
}

static void build_finish(struct driver_build *build)
{
    gpu_buffer_destroy(build->gpu, &build->scratch);
    gpu_buffer_destroy(build->gpu, &build->input);
    memory_free(build->memory, build->counts);
    memory_free(build->memory, build->ranges);
    memory_free(build->memory, build->geometries);
}

enum bvhd_status driver_structure_build(struct gpu *gpu, const struct canonical *canonical, const uint64_t *references,
                                        struct memory *memory, struct driver_structure *ret_structure,
                                        struct bvhd_error *error)
{
    struct driver_build build = {.gpu = gpu, .memory = memory};
    enum bvhd_status status = upload_input(&build, canonical, references, error);
    if (status == BVHD_OK)
        status = describe(&build, canonical, error);
    if (status == BVHD_OK)
        status = build_described(&build, ret_structure, error);
    build_finish(&build);
    return status;
}

enum bvhd_status driver_structure_top_of(struct gpu *gpu, uint64_t address, struct driver_structure *ret_structure,
                                         struct bvhd_error *error)
{
    VkAccelerationStructureInstanceKHR instance = {.transform = {.matrix = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                                   .mask = 0xff,
                                                   .accelerationStructureReference = 1};
    struct canonical_geometry geometry = {
        .type = GEOMETRY_INSTANCES, .primitive_count = 1, .instances = (const unsigned char *)&instance};
    struct canonical canonical = {.bytes = (const unsigned char *)&instance,
                                  .size = sizeof instance,
                                  .type = STRUCTURE_TOP,
                                  .flags = BUILD_PREFER_FAST_TRACE,
                                  .geometry_count = 1,
                                  .primitive_count = 1,
                                  .geometries = &geometry};
    return driver_structure_build(gpu, &canonical, &address, gpu->memory, ret_structure, error);
}

/* ---- Copies ---- */

/* Queries a size that the device computes: VK_QUERY_TYPE_ACCELERATION_STRUCTURE_..._SIZE_KHR. */
static enum bvhd_status query_size(struct gpu *gpu, const struct driver_structure *structure, VkQueryType type,
                                   uint64_t *ret_size, struct bvhd_error *error)
{
    VkQueryPoolCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO, .queryType = type, .queryCount = 1};
    VkQueryPool pool;
    VkCommandBuffer commands;
    uint64_t size = 0;
    enum bvhd_status status =
        gpu_result("vkCreateQueryPool", gpu->vk.CreateQueryPool(gpu->device, &info, NULL, &pool), error);
    if (status != BVHD_OK)
        return status;
    status = gpu_begin(gpu, &commands, error);
    if (status == BVHD_OK) {
        gpu->vk.CmdResetQueryPool(commands, pool, 0, 1);
        gpu->vk.CmdWriteAccelerationStructuresPropertiesKHR(commands, 1, &structure->handle, type, pool, 0);
        status = submit(gpu, commands, error);
    }
    if (status == BVHD_OK)
        status = gpu_result("vkGetQueryPoolResults",
                            gpu->vk.GetQueryPoolResults(gpu->device, pool, 0, 1, sizeof size, &size, sizeof size,
                                                        VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
                            error);
    gpu->vk.DestroyQueryPool(gpu->device, pool, NULL);
    if (status == BVHD_OK)
        *ret_size = size;
    return status;
}

static enum bvhd_status submit_copy(struct gpu *gpu, const VkCopyAccelerationStructureInfoKHR *info,
                                    struct bvhd_error *error)
{
    VkCommandBuffer commands;
    enum bvhd_status status = gpu_begin(gpu, &commands, error);
    if (status != BVHD_OK)
        return status;
    gpu->vk.CmdCopyAccelerationStructureKHR(commands, info);
    return submit(gpu, commands, error);
}

enum bvhd_status driver_structure_copy(struct gpu *gpu, const struct driver_structure *from,
                                       VkCopyAccelerationStructureModeKHR mode, struct driver_structure *ret_structure,
                                       struct bvhd_error *error)
{
    struct driver_structure structure;
    uint64_t size = from->size;
    enum bvhd_status status = BVHD_OK;
    if (mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR)
        status = query_size(gpu, from, VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR, &size, error);
    if (status == BVHD_OK)
        status = create(gpu, from->type, size, &structure, error);
    if (status != BVHD_OK)
        return status;
    VkCopyAccelerationStructureInfoKHR info = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                               .src = from->handle,
                                               .dst = structure.handle,
                                               .mode = mode};
    status = submit_copy(gpu, &info, error);
    if (status != BVHD_OK) {
        driver_structure_destroy(gpu, &structure);
        return status;
    }
    *ret_structure = structure;
    return BVHD_OK;
}

/* ---- Serialized bytes ---- */

/*
 * Creates a buffer that the host can access, in which serialized bytes start at an aligned address, `*ret_shift` bytes
 * after its start.
 */
static enum bvhd_status create_bytes(struct gpu *gpu, uint64_t size, enum gpu_place place,
                                     struct gpu_buffer *ret_buffer, uint64_t *ret_shift, struct bvhd_error *error)
{
    enum bvhd_status status = gpu_buffer_create(
        gpu, size + ALIGNMENT, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT, place,
        ret_buffer, error);
    if (status == BVHD_OK)
        *ret_shift = aligned(ret_buffer->address) - ret_buffer->address;
    return status;
}

static enum bvhd_status copy_from_bytes(struct gpu *gpu, uint64_t address, const struct driver_structure *structure,
                                        struct bvhd_error *error)
{
    VkCommandBuffer commands;
    VkCopyMemoryToAccelerationStructureInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
        .src.deviceAddress = address,
        .dst = structure->handle,
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR};
    enum bvhd_status status = gpu_begin(gpu, &commands, error);
    if (status != BVHD_OK)
        return status;
    gpu->vk.CmdCopyMemoryToAccelerationStructureKHR(commands, &info);
    return submit(gpu, commands, error);
}

enum bvhd_status driver_structure_load(struct gpu *gpu, const void *data, uint64_t size,
                                       struct driver_structure *ret_structure, struct bvhd_error *error)
{
    struct serialized_header header;
    struct driver_structure structure = {0};
    struct gpu_buffer staging = {0};
    uint64_t shift = 0;
    enum bvhd_status status = serialized_read((struct bytes){data, size}, &header, error);
    if (status == BVHD_OK)
        status = create_bytes(gpu, size, GPU_UPLOAD, &staging, &shift, error);
    if (status == BVHD_OK) {
        memcpy((unsigned char *)staging.mapped + shift, data, size);
        /* Without handles it can be of either level. */
        status = create(gpu,
                        header.handle_count ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                            : VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR,
                        header.deserialized_size, &structure, error);
    }
    if (status == BVHD_OK)
        status = copy_from_bytes(gpu, staging.address + shift, &structure, error);
    gpu_buffer_destroy(gpu, &staging);
    if (status != BVHD_OK)
        driver_structure_destroy(gpu, &structure);
    else
        *ret_structure = structure;
    return status;
}

static enum bvhd_status copy_to_bytes(struct gpu *gpu, const struct driver_structure *structure, uint64_t address,
                                      struct bvhd_error *error)
{
    VkCommandBuffer commands;
    VkCopyAccelerationStructureToMemoryInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_TO_MEMORY_INFO_KHR,
        .src = structure->handle,
        .dst.deviceAddress = address,
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR};
    enum bvhd_status status = gpu_begin(gpu, &commands, error);
    if (status != BVHD_OK)
        return status;
    gpu->vk.CmdCopyAccelerationStructureToMemoryKHR(commands, &info);
    return submit(gpu, commands, error);
}

enum bvhd_status driver_structure_serialize(struct gpu *gpu, const struct driver_structure *structure,
                                            struct memory *memory, unsigned char **ret_data, uint64_t *ret_size,
                                            struct bvhd_error *error)
{
    uint64_t size = 0, shift = 0;
    struct gpu_buffer buffer = {0};
    unsigned char *data = NULL;
    enum bvhd_status status =
        query_size(gpu, structure, VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR, &size, error);
    if (status == BVHD_OK)
        status = create_bytes(gpu, size, GPU_READBACK, &buffer, &shift, error);
    if (status == BVHD_OK)
        status = copy_to_bytes(gpu, structure, buffer.address + shift, error);
    if (status == BVHD_OK && !(data = memory_array(memory, size ? size : 1, 1)))
        status = bvhd_error_no_memory(error, "serialize", "no memory for %llu bytes", (unsigned long long)size);
    if (status == BVHD_OK) {
        memcpy(data, (const unsigned char *)buffer.mapped + shift, size);
        *ret_data = data;
        *ret_size = size;
    }
    gpu_buffer_destroy(gpu, &buffer);
    return status;
}
