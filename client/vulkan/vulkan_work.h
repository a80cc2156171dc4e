/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_work.h - commands that the library submits by itself, and waits for: one command buffer, used again and again.
 */
#ifndef BVHD_VULKAN_WORK_H
#define BVHD_VULKAN_WORK_H

#include "client/vulkan/vulkan_device.h"

struct vulkan_work {
    const struct bvhd_vulkan_device *device;
    VkQueue queue;
    VkCommandPool pool;
    VkFence fence;
    VkCommandBuffer commands; /* recording between begin and run */
};

/* End with vulkan_work_finish, also after a failure. */
enum bvhd_status vulkan_work_init(struct vulkan_work *work, const struct bvhd_vulkan_device *device,
                                  const struct bvhd_vulkan_queue *queue, struct bvhd_error *error);
enum bvhd_status vulkan_work_begin(struct vulkan_work *work, struct bvhd_error *error);
/* Submits what was recorded since begin, and waits for it; also after a failure nothing of it is under way. */
enum bvhd_status vulkan_work_run(struct vulkan_work *work, struct bvhd_error *error);
/* Idempotent. */
void vulkan_work_finish(struct vulkan_work *work);

#endif
