/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_work.h - commands that the library submits itself and waits for, with one command buffer that is reused. One
 * thread at a time may use a struct vulkan_work and its queue.
 */
#ifndef BVHD_VULKAN_WORK_H
#define BVHD_VULKAN_WORK_H

#include "client/vulkan/vulkan_device.h"

/* A command buffer and the fence with which its submissions are awaited. */
struct vulkan_work {
    const struct bvhd_vulkan_device *device;
    VkQueue queue;
    VkCommandPool pool;
    VkFence fence;
    VkCommandBuffer commands; /* recording between begin and run */
};

/* Creates the command buffer. It must be ended with vulkan_work_finish, also after a failure. */
enum bvhd_status vulkan_work_init(struct vulkan_work *work, const struct bvhd_vulkan_device *device,
                                  const struct bvhd_vulkan_queue *queue, struct bvhd_error *error);
/* Starts recording. */
enum bvhd_status vulkan_work_begin(struct vulkan_work *work, struct bvhd_error *error);
/* Submits what was recorded since begin and waits for it. Even after a failure nothing of it is still running. */
enum bvhd_status vulkan_work_run(struct vulkan_work *work, struct bvhd_error *error);
/* Frees the command buffer. Repeated calls are allowed. */
void vulkan_work_finish(struct vulkan_work *work);

#endif
