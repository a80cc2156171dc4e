/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>

#include "client/argument.h"
#include "client/library.h"
#include "builder/format/probe.h"
#include "builder/format/serialized.h"
#include "client/vulkan/vulkan_buffer.h"
#include "client/vulkan/vulkan_work.h"

enum {
    /* bytes, of structures and of the memory that they are serialized to */
    ALIGNMENT = 256,
    GEOMETRIES = 2,
    RECORD = 64,
    RECORD_REFERENCE = 56
};

/* The state of one structure of the probe. */
struct step {
    struct probe_request request;
    VkAccelerationStructureGeometryKHR geometries[GEOMETRIES];
    VkAccelerationStructureBuildRangeInfoKHR ranges[GEOMETRIES];
    VkAccelerationStructureBuildGeometryInfoKHR info;
    VkAccelerationStructureBuildSizesInfoKHR sizes;
    uint64_t input_offset; /* of the first geometry's data */
    uint64_t storage_offset;
    uint64_t serialized_offset, serialized_size;
};

struct probing {
    const struct bvhd_vulkan_device *device;
    struct vulkan_work work;
    struct step steps[PROBE_COUNT];
    VkAccelerationStructureKHR structures[PROBE_COUNT];
    uint64_t addresses[PROBE_COUNT];
    struct vulkan_buffer input, storage, scratch, serialized;
    uint64_t scratch_size;
    VkQueryPool queries;
    struct bvhd_error *error;
};

/* ---- What is built ---- */

static const void *geometry_data(const struct canonical_geometry *geometry, uint64_t *ret_size)
{
    switch (geometry->type) {
    case GEOMETRY_TRIANGLES:
        *ret_size = (uint64_t)geometry->vertex_count * 3 * sizeof(float);
        return geometry->positions;
    case GEOMETRY_AABBS:
        *ret_size = (uint64_t)geometry->primitive_count * 6 * sizeof(float);
        return geometry->boxes;
    default:
        *ret_size = (uint64_t)geometry->primitive_count * RECORD;
        return geometry->instances;
    }
}

/* Describes a geometry, without the address of its data yet. */
static VkAccelerationStructureGeometryKHR describe_geometry(const struct canonical_geometry *geometry)
{
    VkAccelerationStructureGeometryKHR described = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                                                    .flags = geometry->flags};
    switch (geometry->type) {
    case GEOMETRY_TRIANGLES:
        described.geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
        described.geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
            .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
            .vertexStride = 3 * sizeof(float),
            .maxVertex = geometry->vertex_count > 0 ? geometry->vertex_count - 1 : 0,
            .indexType = VK_INDEX_TYPE_NONE_KHR};
        break;
    case GEOMETRY_AABBS:
        described.geometryType = VK_GEOMETRY_TYPE_AABBS_KHR;
        described.geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR, .stride = 6 * sizeof(float)};
        break;
    default:
        described.geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR;
        described.geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR};
    }
    return described;
}

static void describe_step(const struct bvhd_vulkan_device *device, enum probe_structure which, struct step *step)
{
    uint32_t counts[GEOMETRIES];
    probe_request_init(&step->request, which);
    const struct canonical *canonical = &step->request.canonical;
    for (uint32_t g = 0; g < canonical->geometry_count; g++) {
        step->geometries[g] = describe_geometry(&canonical->geometries[g]);
        counts[g] = canonical->geometries[g].primitive_count;
        step->ranges[g] = (VkAccelerationStructureBuildRangeInfoKHR){.primitiveCount = counts[g]};
    }
    step->info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = canonical->type == STRUCTURE_TOP ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                                 : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
        .flags = canonical->flags,
        .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .geometryCount = canonical->geometry_count,
        .pGeometries = step->geometries};
    step->sizes.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR;
    device->vk.GetAccelerationStructureBuildSizesKHR(device->handle, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR,
                                                     &step->info, counts, &step->sizes);
}

/* Describes all structures, and assigns places to their input and their storage. */
static void lay_out(struct probing *probing, uint64_t *ret_input_size, uint64_t *ret_storage_size)
{
    uint64_t input = 0, storage = 0;
    for (int i = 0; i < PROBE_COUNT; i++) {
        struct step *step = &probing->steps[i];
        describe_step(probing->device, (enum probe_structure)i, step);
        step->input_offset = input;
        for (uint32_t g = 0; g < step->request.canonical.geometry_count; g++) {
            uint64_t size;
            (void)geometry_data(&step->request.canonical.geometries[g], &size);
            input = bytes_align(input + size, 16);
        }
        step->storage_offset = storage;
        storage += bytes_align(step->sizes.accelerationStructureSize, ALIGNMENT);
        if (step->sizes.buildScratchSize > probing->scratch_size)
            probing->scratch_size = step->sizes.buildScratchSize;
    }
    *ret_input_size = input;
    *ret_storage_size = storage;
}

static enum bvhd_status create_objects(struct probing *probing)
{
    const struct bvhd_vulkan_device *device = probing->device;
    const VkBufferUsageFlags address = VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
    uint64_t input_size = 0, storage_size = 0;
    lay_out(probing, &input_size, &storage_size);
    enum bvhd_status status = vulkan_buffer_create(
        device, input_size + 16, address | VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR,
        VULKAN_HOST, &probing->input, probing->error);
    if (status == BVHD_OK)
        status = vulkan_buffer_create(device, storage_size,
                                      address | VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR |
                                          VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                                      VULKAN_DEVICE, &probing->storage, probing->error);
    if (status == BVHD_OK)
        status = vulkan_buffer_create(device, probing->scratch_size + device->limits.scratch_alignment,
                                      address | VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, VULKAN_DEVICE, &probing->scratch,
                                      probing->error);
    if (status != BVHD_OK)
        return status;
    const VkQueryPoolCreateInfo queries = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                           .queryType = VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR,
                                           .queryCount = PROBE_COUNT};
    VkResult result = device->vk.CreateQueryPool(device->handle, &queries, device->allocator, &probing->queries);
    return vulkan_device_result("vkCreateQueryPool", result, probing->error);
}

static enum bvhd_status create_structure(struct probing *probing, int which)
{
    const struct bvhd_vulkan_device *device = probing->device;
    const struct step *step = &probing->steps[which];
    const VkAccelerationStructureCreateInfoKHR info = {.sType =
                                                           VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                       .buffer = probing->storage.buffer,
                                                       .offset = step->storage_offset,
                                                       .size = step->sizes.accelerationStructureSize,
                                                       .type = step->info.type};
    VkResult result = device->vk.CreateAccelerationStructureKHR(device->handle, &info, device->allocator,
                                                                &probing->structures[which]);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkCreateAccelerationStructureKHR", result, probing->error);
    const VkAccelerationStructureDeviceAddressInfoKHR address = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
        .accelerationStructure = probing->structures[which]};
    probing->addresses[which] = device->vk.GetAccelerationStructureDeviceAddressKHR(device->handle, &address);
    return BVHD_OK;
}

/* Writes the geometry that the device reads. Instances name the previous structures. */
static void write_input(struct probing *probing, struct step *step)
{
    uint64_t base = bytes_align(probing->input.address, 16) - probing->input.address + step->input_offset;
    for (uint32_t g = 0; g < step->request.canonical.geometry_count; g++) {
        const struct canonical_geometry *geometry = &step->request.canonical.geometries[g];
        uint64_t size;
        const void *data = geometry_data(geometry, &size);
        unsigned char *dest = probing->input.mapped + base;
        if (size > 0)
            memcpy(dest, data, size);
        for (uint32_t i = 0; geometry->type == GEOMETRY_INSTANCES && i < geometry->primitive_count; i++) {
            uint64_t reference = bytes_get64(geometry->instances + (uint64_t)RECORD * i + RECORD_REFERENCE);
            bytes_put64(dest + (uint64_t)RECORD * i + RECORD_REFERENCE,
                        reference ? probing->addresses[reference - 1] : 0);
        }
        VkDeviceOrHostAddressConstKHR address = {.deviceAddress = probing->input.address + base};
        VkAccelerationStructureGeometryDataKHR *described = &step->geometries[g].geometry;
        if (geometry->type == GEOMETRY_TRIANGLES)
            described->triangles.vertexData = address;
        else if (geometry->type == GEOMETRY_AABBS)
            described->aabbs.data = address;
        else
            described->instances.data = address;
        base = bytes_align(base + size, 16);
    }
}

/* ---- What is recorded ---- */

static void record_barrier(const struct probing *probing, VkPipelineStageFlags source, VkAccessFlags written,
                           VkPipelineStageFlags target, VkAccessFlags wanted)
{
    const VkMemoryBarrier barrier = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER, .srcAccessMask = written, .dstAccessMask = wanted};
    probing->device->vk.CmdPipelineBarrier(probing->work.commands, source, target, 0, 1, &barrier, 0, NULL, 0, NULL);
}

/*
 * The storage is cleared first, so that bytes that the driver does not write are zero: a probe must not depend on the
 * memory's previous contents.
 */
static void record_build(struct probing *probing)
{
    const struct bvhd_vulkan_device *device = probing->device;
    const VkPipelineStageFlags build = VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR;
    const VkAccessFlags both =
        VK_ACCESS_ACCELERATION_STRUCTURE_READ_BIT_KHR | VK_ACCESS_ACCELERATION_STRUCTURE_WRITE_BIT_KHR;
    VkCommandBuffer commands = probing->work.commands;
    device->vk.CmdResetQueryPool(commands, probing->queries, 0, PROBE_COUNT);
    device->vk.CmdFillBuffer(commands, probing->storage.buffer, 0, VK_WHOLE_SIZE, 0);
    record_barrier(probing, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT, build, both);
    for (int i = 0; i < PROBE_COUNT; i++) {
        struct step *step = &probing->steps[i];
        const VkAccelerationStructureBuildRangeInfoKHR *ranges = step->ranges;
        step->info.dstAccelerationStructure = probing->structures[i];
        step->info.scratchData.deviceAddress = bytes_align(probing->scratch.address, device->limits.scratch_alignment);
        device->vk.CmdBuildAccelerationStructuresKHR(commands, 1, &step->info, &ranges);
        record_barrier(probing, build, both, build, both);
    }
    device->vk.CmdWriteAccelerationStructuresPropertiesKHR(commands, PROBE_COUNT, probing->structures,
                                                           VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR,
                                                           probing->queries, 0);
}

static void record_serialize(struct probing *probing)
{
    const struct bvhd_vulkan_device *device = probing->device;
    uint64_t base = bytes_align(probing->serialized.address, ALIGNMENT);
    for (int i = 0; i < PROBE_COUNT; i++) {
        const VkCopyAccelerationStructureToMemoryInfoKHR copy = {
            .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_TO_MEMORY_INFO_KHR,
            .src = probing->structures[i],
            .dst.deviceAddress = base + probing->steps[i].serialized_offset,
            .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR};
        device->vk.CmdCopyAccelerationStructureToMemoryKHR(probing->work.commands, &copy);
    }
    record_barrier(probing, VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR, VK_ACCESS_TRANSFER_WRITE_BIT,
                   VK_PIPELINE_STAGE_HOST_BIT, VK_ACCESS_HOST_READ_BIT);
}

/* ---- The two submissions ---- */

static enum bvhd_status build_all(struct probing *probing)
{
    for (int i = 0; i < PROBE_COUNT; i++) {
        enum bvhd_status status = create_structure(probing, i);
        if (status != BVHD_OK)
            return status;
        write_input(probing, &probing->steps[i]);
    }
    enum bvhd_status status = vulkan_work_begin(&probing->work, probing->error);
    if (status != BVHD_OK)
        return status;
    record_build(probing);
    return vulkan_work_run(&probing->work, probing->error);
}

static enum bvhd_status find_sizes(struct probing *probing, uint64_t *ret_size)
{
    uint64_t sizes[PROBE_COUNT], end = 0;
    const struct bvhd_vulkan_device *device = probing->device;
    VkResult result =
        device->vk.GetQueryPoolResults(device->handle, probing->queries, 0, PROBE_COUNT, sizeof sizes, sizes,
                                       sizeof sizes[0], VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkGetQueryPoolResults", result, probing->error);
    for (int i = 0; i < PROBE_COUNT; i++) {
        if (sizes[i] > PROBE_MAX_STRUCTURE)
            return bvhd_error_set(probing->error, BVHD_TOO_LARGE, "probe",
                                  "the device serializes a tiny structure to %" PRIu64 " bytes", sizes[i]);
        probing->steps[i].serialized_offset = end;
        probing->steps[i].serialized_size = sizes[i];
        end += bytes_align(sizes[i], ALIGNMENT);
    }
    *ret_size = end;
    return BVHD_OK;
}

static enum bvhd_status serialize_all(struct probing *probing)
{
    uint64_t size = 0;
    enum bvhd_status status = find_sizes(probing, &size);
    if (status == BVHD_OK)
        status = vulkan_buffer_create(probing->device, size + ALIGNMENT,
                                      VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                                      VULKAN_HOST, &probing->serialized, probing->error);
    if (status == BVHD_OK)
        status = vulkan_work_begin(&probing->work, probing->error);
    if (status != BVHD_OK)
        return status;
    memset(probing->serialized.mapped, 0, size + ALIGNMENT);
    record_serialize(probing);
    return vulkan_work_run(&probing->work, probing->error);
}

/*
 * Addresses differ from run to run. They are replaced by rows + 1 wherever they occur, so that equal devices give equal
 * probes.
 */
static void number_handles(struct probe *probe, unsigned char *instances)
{
    uint64_t size = probe->structures[PROBE_INSTANCES].size;
    for (uint64_t at = SERIALIZED_HANDLES; at + 8 <= size; at++)
        for (int i = 0; i < PROBE_COUNT; i++)
            if (bytes_get64(instances + at) == probe->handles[i])
                bytes_put64(instances + at, (uint64_t)i + 1);
    for (int i = 0; i < PROBE_COUNT; i++)
        probe->handles[i] = (uint64_t)i + 1;
}

static enum bvhd_status pack(const struct probing *probing, unsigned char **ret_data, uint64_t *ret_size)
{
    struct probe probe = {.handles = {0}};
    uint64_t base = bytes_align(probing->serialized.address, ALIGNMENT) - probing->serialized.address;
    snprintf(probe.device, sizeof probe.device, "%s", probing->device->name);
    snprintf(probe.driver, sizeof probe.driver, "%.*s", PROBE_NAME_SIZE - 1, probing->device->driver);
    for (int i = 0; i < PROBE_COUNT; i++) {
        probe.handles[i] = probing->addresses[i];
        probe.structures[i] = (struct bytes){probing->serialized.mapped + base + probing->steps[i].serialized_offset,
                                             probing->steps[i].serialized_size};
    }
    number_handles(&probe, probing->serialized.mapped + base + probing->steps[PROBE_INSTANCES].serialized_offset);
    return probe_pack(&probe, &library_memory, ret_data, ret_size, probing->error);
}

static void finish(struct probing *probing)
{
    const struct bvhd_vulkan_device *device = probing->device;
    vulkan_work_finish(&probing->work);
    for (int i = 0; i < PROBE_COUNT; i++)
        if (probing->structures[i])
            device->vk.DestroyAccelerationStructureKHR(device->handle, probing->structures[i], device->allocator);
    if (probing->queries)
        device->vk.DestroyQueryPool(device->handle, probing->queries, device->allocator);
    vulkan_buffer_destroy(device, &probing->input);
    vulkan_buffer_destroy(device, &probing->storage);
    vulkan_buffer_destroy(device, &probing->scratch);
    vulkan_buffer_destroy(device, &probing->serialized);
}

enum bvhd_status bvhd_vulkan_probe(struct bvhd_vulkan_device *device, const struct bvhd_vulkan_queue *queue,
                                   void **ret_probe, uint64_t *ret_size, struct bvhd_error *ret_error)
{
    struct probing probing = {.device = device, .error = ret_error};
    unsigned char *data = NULL;
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {device, "device"}, {queue, "queue"}, {ret_probe, "ret_probe"},
                                              {ret_size, "ret_size"});
    if (status != BVHD_OK)
        return status;
    if (!device->has_structures)
        return bvhd_error_set(ret_error, BVHD_UNSUPPORTED, "device",
                              "it has no acceleration structures: it needs target portable");
    status = vulkan_work_init(&probing.work, device, queue, ret_error);
    if (status == BVHD_OK)
        status = create_objects(&probing);
    if (status == BVHD_OK)
        status = build_all(&probing);
    if (status == BVHD_OK)
        status = serialize_all(&probing);
    if (status == BVHD_OK)
        status = pack(&probing, &data, ret_size);
    if (status == BVHD_OK)
        *ret_probe = data;
    finish(&probing);
    return status;
}

void bvhd_vulkan_free(void *block)
{
    memory_free(&library_memory, block);
}
