/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan/vulkan_buffer.h"

#include <inttypes.h>
#include <string.h>

enum {
    LOCAL = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT,
    COHERENT = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
    CACHED = VK_MEMORY_PROPERTY_HOST_CACHED_BIT,
    PLAIN = LOCAL | COHERENT | CACHED,
    CHOICES = 4
};

/* The memory types for each place, the best first: a type matches if its flags among `among` are exactly `has`. */
static const struct {
    VkMemoryPropertyFlags among, has;
} choices[][CHOICES] = {
    [VULKAN_DEVICE] = {{LOCAL, LOCAL}, {LOCAL, 0}},
    [VULKAN_HOST] = {{LOCAL | COHERENT, COHERENT}, {LOCAL | COHERENT, LOCAL | COHERENT}},
    [VULKAN_READBACK] = {{PLAIN, COHERENT | CACHED}, {PLAIN, PLAIN}, {PLAIN, COHERENT}, {PLAIN, LOCAL | COHERENT}},
};

static VkResult allocate_of(const struct bvhd_vulkan_device *device, VkDeviceSize size, uint32_t type, bool has_address,
                            VkDeviceMemory *ret_memory)
{
    const VkMemoryAllocateFlagsInfo flags = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
                                             .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
    const VkMemoryAllocateInfo info = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                       .pNext = has_address ? &flags : NULL,
                                       .allocationSize = size,
                                       .memoryTypeIndex = type};
    return device->vk.AllocateMemory(device->handle, &info, device->allocator, ret_memory);
}

/*
 * Allocates the best type of memory that the device has left. Memory with other properties than PLAIN has special
 * rules, and is not used.
 */
static enum bvhd_status allocate(const struct bvhd_vulkan_device *device, const VkMemoryRequirements *requirements,
                                 enum vulkan_place place, struct vulkan_buffer *buffer, bool has_address,
                                 struct bvhd_error *error)
{
    VkResult result = VK_ERROR_OUT_OF_DEVICE_MEMORY;
    for (int choice = 0; choice < CHOICES && choices[place][choice].among; choice++)
        for (uint32_t type = 0; type < device->memory.memoryTypeCount; type++) {
            VkMemoryPropertyFlags flags = device->memory.memoryTypes[type].propertyFlags;
            if (!(requirements->memoryTypeBits >> type & 1) || (flags & ~(VkMemoryPropertyFlags)PLAIN) ||
                (flags & choices[place][choice].among) != choices[place][choice].has)
                continue;
            result = allocate_of(device, requirements->size, type, has_address, &buffer->memory);
            if (result != VK_ERROR_OUT_OF_DEVICE_MEMORY)
                return vulkan_device_result("vkAllocateMemory", result, error);
        }
    return vulkan_device_result("vkAllocateMemory", result, error);
}

static enum bvhd_status fill_buffer(const struct bvhd_vulkan_device *device, VkBufferUsageFlags usage,
                                    enum vulkan_place place, struct vulkan_buffer *buffer, struct bvhd_error *error)
{
    bool has_address = usage & VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
    const VkBufferCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .size = buffer->size, .usage = usage};
    VkResult result = device->vk.CreateBuffer(device->handle, &info, device->allocator, &buffer->buffer);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkCreateBuffer", result, error);
    VkMemoryRequirements requirements;
    device->vk.GetBufferMemoryRequirements(device->handle, buffer->buffer, &requirements);
    enum bvhd_status status = allocate(device, &requirements, place, buffer, has_address, error);
    if (status != BVHD_OK)
        return status;
    result = device->vk.BindBufferMemory(device->handle, buffer->buffer, buffer->memory, 0);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkBindBufferMemory", result, error);
    if (has_address) {
        const VkBufferDeviceAddressInfo which = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO,
                                                 .buffer = buffer->buffer};
        buffer->address = device->vk.GetBufferDeviceAddress(device->handle, &which);
    }
    if (place == VULKAN_DEVICE)
        return BVHD_OK;
    void *mapped;
    result = device->vk.MapMemory(device->handle, buffer->memory, 0, VK_WHOLE_SIZE, 0, &mapped);
    if (result == VK_SUCCESS)
        buffer->mapped = mapped;
    return result == VK_ERROR_MEMORY_MAP_FAILED ? bvhd_error_no_memory(error, "vkMapMemory", "no room for a mapping")
                                                : vulkan_device_result("vkMapMemory", result, error);
}

enum bvhd_status vulkan_buffer_create(const struct bvhd_vulkan_device *device, VkDeviceSize size,
                                      VkBufferUsageFlags usage, enum vulkan_place place,
                                      struct vulkan_buffer *ret_buffer, struct bvhd_error *error)
{
    uint64_t limit =
        device->limits.buffer < device->limits.allocation ? device->limits.buffer : device->limits.allocation;
    if (size > limit)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "size",
                              "%" PRIu64 " bytes, the device has buffers of at most %" PRIu64, (uint64_t)size, limit);
    struct vulkan_buffer buffer = {.size = size};
    enum bvhd_status status = fill_buffer(device, usage, place, &buffer, error);
    if (status == BVHD_OK)
        *ret_buffer = buffer;
    else
        vulkan_buffer_destroy(device, &buffer);
    return status;
}

void vulkan_buffer_destroy(const struct bvhd_vulkan_device *device, struct vulkan_buffer *buffer)
{
    if (buffer->buffer)
        device->vk.DestroyBuffer(device->handle, buffer->buffer, device->allocator);
    if (buffer->memory)
        device->vk.FreeMemory(device->handle, buffer->memory, device->allocator);
    memset(buffer, 0, sizeof *buffer);
}
