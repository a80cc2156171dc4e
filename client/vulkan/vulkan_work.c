/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan/vulkan_work.h"

#include <string.h>

enum bvhd_status vulkan_work_init(struct vulkan_work *work, const struct bvhd_vulkan_device *device,
                                  const struct bvhd_vulkan_queue *queue, struct bvhd_error *error)
{
    *work = (struct vulkan_work){.device = device, .queue = queue->queue};
    const VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                          .flags = VK_COMMAND_POOL_CREATE_TRANSIENT_BIT,
                                          .queueFamilyIndex = queue->family};
    VkResult result = device->vk.CreateCommandPool(device->handle, &pool, device->allocator, &work->pool);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkCreateCommandPool", result, error);
    const VkCommandBufferAllocateInfo commands = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                                  .commandPool = work->pool,
                                                  .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
                                                  .commandBufferCount = 1};
    result = device->vk.AllocateCommandBuffers(device->handle, &commands, &work->commands);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkAllocateCommandBuffers", result, error);
    const VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    result = device->vk.CreateFence(device->handle, &fence, device->allocator, &work->fence);
    return vulkan_device_result("vkCreateFence", result, error);
}

enum bvhd_status vulkan_work_begin(struct vulkan_work *work, struct bvhd_error *error)
{
    const struct bvhd_vulkan_device *device = work->device;
    VkResult result = device->vk.ResetCommandPool(device->handle, work->pool, 0);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkResetCommandPool", result, error);
    const VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                            .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT};
    return vulkan_device_result("vkBeginCommandBuffer", device->vk.BeginCommandBuffer(work->commands, &begin), error);
}

enum bvhd_status vulkan_work_run(struct vulkan_work *work, struct bvhd_error *error)
{
    const struct bvhd_vulkan_device *device = work->device;
    VkResult result = device->vk.EndCommandBuffer(work->commands);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkEndCommandBuffer", result, error);
    const VkSubmitInfo submit = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &work->commands};
    result = device->vk.QueueSubmit(work->queue, 1, &submit, work->fence);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkQueueSubmit", result, error);
    result = device->vk.WaitForFences(device->handle, 1, &work->fence, VK_TRUE, UINT64_MAX);
    if (result != VK_SUCCESS) {
        /*
         * If the wait fails, the work may still be running, and the caller is about to destroy its objects. A lost
         * device uses nothing any more.
         */
        (void)device->vk.QueueWaitIdle(work->queue);
        (void)device->vk.ResetFences(device->handle, 1, &work->fence);
        return vulkan_device_result("vkWaitForFences", result, error);
    }
    return vulkan_device_result("vkResetFences", device->vk.ResetFences(device->handle, 1, &work->fence), error);
}

void vulkan_work_finish(struct vulkan_work *work)
{
    const struct bvhd_vulkan_device *device = work->device;
    if (!device)
        return;
    if (work->fence)
        device->vk.DestroyFence(device->handle, work->fence, device->allocator);
    if (work->pool)
        device->vk.DestroyCommandPool(device->handle, work->pool, device->allocator);
    memset(work, 0, sizeof *work);
}
