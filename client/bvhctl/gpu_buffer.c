/* SPDX-License-Identifier: Apache-2.0 */
#include "gpu_instance.h"
#include "status.h"

static uint32_t count_bits(VkMemoryPropertyFlags flags)
{
    return (uint32_t)__builtin_popcount(flags);
}

/* The type of memory that has all of `needed`, most of `wanted`, and then least of what nobody asked for. */
static bool find_type(const VkPhysicalDeviceMemoryProperties *memory, uint32_t allowed, VkMemoryPropertyFlags needed,
                      VkMemoryPropertyFlags wanted, uint32_t *ret_type)
{
    bool is_found = false;
    int best = 0;
    for (uint32_t i = 0; i < memory->memoryTypeCount; i++) {
        VkMemoryPropertyFlags flags = memory->memoryTypes[i].propertyFlags;
        if (!(allowed >> i & 1) || (flags & needed) != needed || (flags & VK_MEMORY_PROPERTY_PROTECTED_BIT))
            continue;
        int score = 32 * (int)count_bits(flags & wanted) - (int)count_bits(flags & ~(wanted | needed));
        if (is_found && score <= best)
            continue;
        is_found = true;
        best = score;
        *ret_type = i;
    }
    return is_found;
}

static bool choose_type(const struct gpu *gpu, uint32_t allowed, enum gpu_place place, uint32_t *ret_type)
{
    const VkMemoryPropertyFlags host = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    VkPhysicalDeviceMemoryProperties memory;
    gpu->owner->vk.GetPhysicalDeviceMemoryProperties(gpu->physical, &memory);
    switch (place) {
    case GPU_UPLOAD:
        return find_type(&memory, allowed, host, 0, ret_type);
    case GPU_READBACK:
        return find_type(&memory, allowed, host, VK_MEMORY_PROPERTY_HOST_CACHED_BIT, ret_type);
    default:
        return find_type(&memory, allowed, 0, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, ret_type);
    }
}

static enum bvhd_status allocate(struct gpu *gpu, struct gpu_buffer *buffer, enum gpu_place place, struct bvhd_error *error)
{
    VkMemoryRequirements requirements;
    const VkMemoryAllocateFlagsInfo flags = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
                                             .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
    VkMemoryAllocateInfo info = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                 .pNext = gpu->facts.has_buffer_address ? &flags : NULL};
    gpu->vk.GetBufferMemoryRequirements(gpu->device, buffer->buffer, &requirements);
    info.allocationSize = requirements.size;
    if (!choose_type(gpu, requirements.memoryTypeBits, place, &info.memoryTypeIndex))
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "vkAllocateMemory", "the device has no memory of the kind that is needed");
    enum bvhd_status status = gpu_result("vkAllocateMemory", gpu->vk.AllocateMemory(gpu->device, &info, NULL, &buffer->memory), error);
    if (!status)
        status = gpu_result("vkBindBufferMemory", gpu->vk.BindBufferMemory(gpu->device, buffer->buffer, buffer->memory, 0), error);
    if (!status && place != GPU_DEVICE)
        status = gpu_result("vkMapMemory", gpu->vk.MapMemory(gpu->device, buffer->memory, 0, VK_WHOLE_SIZE, 0, &buffer->mapped), error);
    return status;
}

enum bvhd_status gpu_buffer_create(struct gpu *gpu, VkDeviceSize size, VkBufferUsageFlags usage, enum gpu_place place,
                                   struct gpu_buffer *ret_buffer, struct bvhd_error *error)
{
    struct gpu_buffer buffer = {.size = size ? size : 1};
    bool has_address = gpu->facts.has_buffer_address;
    const VkBufferCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
        .size = buffer.size,
        .usage = usage | (has_address ? VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT : 0),
        .sharingMode = VK_SHARING_MODE_EXCLUSIVE,
    };
    enum bvhd_status status = gpu_result("vkCreateBuffer", gpu->vk.CreateBuffer(gpu->device, &info, NULL, &buffer.buffer), error);
    if (!status)
        status = allocate(gpu, &buffer, place, error);
    if (status) {
        gpu_buffer_destroy(gpu, &buffer);
        return status;
    }
    const VkBufferDeviceAddressInfo address = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, .buffer = buffer.buffer};
    buffer.address = has_address ? gpu->vk.GetBufferDeviceAddress(gpu->device, &address) : 0;
    *ret_buffer = buffer;
    return BVHD_OK;
}

void gpu_buffer_destroy(struct gpu *gpu, struct gpu_buffer *buffer)
{
    if (!gpu || !buffer)
        return;
    gpu->vk.DestroyBuffer(gpu->device, buffer->buffer, NULL);
    gpu->vk.FreeMemory(gpu->device, buffer->memory, NULL);
    *buffer = (struct gpu_buffer){.size = 0};
}
