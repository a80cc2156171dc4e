/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>

#include "client/argument.h"
#include "client/vulkan/vulkan_blob.h"
#include "client/vulkan/vulkan_device.h"

static enum bvhd_status check_span(const struct bvhd_vulkan_span *span, VkDeviceSize size, VkDeviceSize alignment,
                                   const char *where, struct bvhd_error *error)
{
    if (!span->buffer)
        return bvhd_error_set(error, BVHD_INVALID, where, "its buffer is VK_NULL_HANDLE");
    if (span->size < size)
        return bvhd_error_set(error, BVHD_INVALID, where, "%" PRIu64 " bytes, but %" PRIu64 " are needed",
                              (uint64_t)span->size, (uint64_t)size);
    if (span->offset % alignment != 0)
        return bvhd_error_set(error, BVHD_INVALID, where, "its offset is no multiple of %" PRIu64, (uint64_t)alignment);
    return BVHD_OK;
}

static enum bvhd_status check_upload(const struct bvhd_vulkan_device *device, const struct bvhd_vulkan_upload *upload,
                                     const struct vulkan_blob *blob, struct bvhd_error *error)
{
    const struct bvhd_vulkan_requirements needed = vulkan_blob_requirements(blob, device);
    bool is_native = blob->target != BVHD_TARGET_PORTABLE;
    if (is_native && !device->has_structures)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "upload.data",
                              "a native structure, but the device has no acceleration structures");
    if (!upload->staging_mapped)
        return bvhd_error_set(error, BVHD_INVALID, "upload.staging_mapped", "upload.staging_mapped is NULL");
    /* For native structures the device address has to be aligned, which record_native checks. */
    enum bvhd_status status = check_span(&upload->staging, needed.staging_size,
                                         is_native ? 1 : needed.staging_alignment, "upload.staging", error);
    if (status == BVHD_OK)
        status = check_span(&upload->storage, needed.storage_size, needed.storage_alignment, "upload.storage", error);
    /* Offset 0 is a valid location, address 0 is not. */
    if (status == BVHD_OK)
        status = vulkan_blob_check_references(blob, upload->references, upload->reference_count,
                                              is_native ? 0 : UINT64_MAX, error);
    return status;
}

static enum bvhd_status create_structure(const struct bvhd_vulkan_device *device,
                                         const struct bvhd_vulkan_upload *upload, const struct vulkan_blob *blob,
                                         VkAccelerationStructureKHR *ret_structure, struct bvhd_error *error)
{
    /* The structure must not be larger than the original: some drivers serialize as many bytes as were created. */
    const VkAccelerationStructureCreateInfoKHR info = {.sType =
                                                           VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                       .buffer = upload->storage.buffer,
                                                       .offset = upload->storage.offset,
                                                       .size = blob->body.size,
                                                       .type = blob->type};
    VkResult result =
        device->vk.CreateAccelerationStructureKHR(device->handle, &info, device->allocator, ret_structure);
    return vulkan_device_result("vkCreateAccelerationStructureKHR", result, error);
}

static enum bvhd_status record_native(const struct bvhd_vulkan_device *device, VkCommandBuffer commands,
                                      const struct bvhd_vulkan_upload *upload, const struct vulkan_blob *blob,
                                      VkAccelerationStructureKHR *ret_structure, struct bvhd_error *error)
{
    const VkBufferDeviceAddressInfo which = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO,
                                             .buffer = upload->staging.buffer};
    VkDeviceAddress source = device->vk.GetBufferDeviceAddress(device->handle, &which) + upload->staging.offset;
    uint64_t alignment = vulkan_blob_requirements(blob, device).staging_alignment;
    if (source % alignment != 0)
        return bvhd_error_set(error, BVHD_INVALID, "upload.staging", "its device address is no multiple of %" PRIu64,
                              alignment);
    VkCopyMemoryToAccelerationStructureInfoKHR copy = {
        .sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
        .src.deviceAddress = source,
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR};
    enum bvhd_status status = create_structure(device, upload, blob, &copy.dst, error);
    if (status != BVHD_OK)
        return status;
    vulkan_blob_fill_native(blob, upload->references, upload->staging_mapped);
    device->vk.CmdCopyMemoryToAccelerationStructureKHR(commands, &copy);
    *ret_structure = copy.dst;
    return BVHD_OK;
}

static enum bvhd_status record_portable(const struct bvhd_vulkan_device *device, VkCommandBuffer commands,
                                        const struct bvhd_vulkan_upload *upload, const struct vulkan_blob *blob,
                                        VkAccelerationStructureKHR *ret_structure, struct bvhd_error *error)
{
    enum bvhd_status status =
        vulkan_blob_fill_portable(blob, upload->references, 0, blob->body.size, upload->staging_mapped, error);
    if (status != BVHD_OK)
        return status;
    const VkBufferCopy copy = {upload->staging.offset, upload->storage.offset, blob->body.size};
    device->vk.CmdCopyBuffer(commands, upload->staging.buffer, upload->storage.buffer, 1, &copy);
    *ret_structure = VK_NULL_HANDLE;
    return BVHD_OK;
}

enum bvhd_status bvhd_vulkan_record_upload(struct bvhd_vulkan_device *device, VkCommandBuffer commands,
                                           const struct bvhd_vulkan_upload *upload,
                                           VkAccelerationStructureKHR *ret_structure, struct bvhd_error *ret_error)
{
    struct vulkan_blob blob;
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {device, "device"}, {commands, "commands"}, {upload, "upload"},
                                              {ret_structure, "ret_structure"});
    if (status == BVHD_OK)
        status = argument_check_size(upload, sizeof *upload, sizeof *upload, "upload", "bvhd_vulkan_upload", ret_error);
    if (status == BVHD_OK)
        status = ARGUMENTS_CHECK(ret_error, {upload->data, "upload.data"});
    if (status == BVHD_OK)
        status = vulkan_blob_read((struct bytes){upload->data, upload->size}, &blob, ret_error);
    if (status == BVHD_OK)
        status = check_upload(device, upload, &blob, ret_error);
    if (status != BVHD_OK)
        return status;
    return blob.target == BVHD_TARGET_PORTABLE
               ? record_portable(device, commands, upload, &blob, ret_structure, ret_error)
               : record_native(device, commands, upload, &blob, ret_structure, ret_error);
}

void bvhd_vulkan_record_barrier(struct bvhd_vulkan_device *device, VkCommandBuffer commands)
{
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                               .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                               .dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT};
    VkPipelineStageFlags stages = VK_PIPELINE_STAGE_TRANSFER_BIT;
    if (!device || !commands)
        return;
    if (device->has_structures) {
        barrier.srcAccessMask |= VK_ACCESS_ACCELERATION_STRUCTURE_WRITE_BIT_KHR;
        stages |= VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR;
    }
    device->vk.CmdPipelineBarrier(commands, stages, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, 0, 1, &barrier, 0, NULL, 0,
                                  NULL);
}

uint64_t bvhd_vulkan_address(struct bvhd_vulkan_device *device, VkAccelerationStructureKHR structure)
{
    const VkAccelerationStructureDeviceAddressInfoKHR which = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR, .accelerationStructure = structure};
    return device && device->has_structures && structure
               ? device->vk.GetAccelerationStructureDeviceAddressKHR(device->handle, &which)
               : 0;
}
