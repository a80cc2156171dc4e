/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/gpu/gpu.h"
#include "client/vulkan/vulkan_buffer.h"

static enum vulkan_place place_of(enum gpu_place place)
{
    return place == GPU_DEVICE ? VULKAN_DEVICE : place == GPU_UPLOAD ? VULKAN_HOST : VULKAN_READBACK;
}

enum bvhd_status gpu_buffer_create(struct gpu *gpu, VkDeviceSize size, VkBufferUsageFlags usage, enum gpu_place place,
                                   struct gpu_buffer *ret_buffer, struct bvhd_error *error)
{
    struct vulkan_buffer buffer;
    if (gpu->properties.has_buffer_address)
        usage |= VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
    enum bvhd_status status =
        vulkan_buffer_create(gpu->library, size ? size : 1, usage, place_of(place), &buffer, error);
    if (status == BVHD_OK)
        *ret_buffer = (struct gpu_buffer){buffer.buffer, buffer.memory, buffer.size, buffer.mapped, buffer.address};
    return status;
}

void gpu_buffer_destroy(struct gpu *gpu, struct gpu_buffer *buffer)
{
    if (!gpu || !buffer)
        return;
    struct vulkan_buffer all = {.buffer = buffer->buffer, .memory = buffer->memory};
    vulkan_buffer_destroy(gpu->library, &all);
    *buffer = (struct gpu_buffer){.size = 0};
}
