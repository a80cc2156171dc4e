/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/gpu/gpu.h"

enum bvhd_status gpu_begin(struct gpu *gpu, VkCommandBuffer *ret_commands, struct bvhd_error *error)
{
    enum bvhd_status status = vulkan_work_begin(&gpu->work, error);
    if (status == BVHD_OK)
        *ret_commands = gpu->work.commands;
    return status;
}

enum bvhd_status gpu_submit(struct gpu *gpu, VkCommandBuffer commands, struct bvhd_error *error)
{
    (void)commands; /* the device has no others */
    return vulkan_work_run(&gpu->work, error);
}

enum { TIMER_QUERIES = 2 };

enum bvhd_status gpu_timer_create(struct gpu *gpu, struct gpu_timer *ret_timer, struct bvhd_error *error)
{
    struct gpu_timer timer = {VK_NULL_HANDLE};
    const VkQueryPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                        .queryType = VK_QUERY_TYPE_TIMESTAMP,
                                        .queryCount = TIMER_QUERIES};
    enum bvhd_status status = BVHD_OK;
    if (gpu->timestamp_ms > 0)
        status = gpu_result("vkCreateQueryPool", gpu->vk.CreateQueryPool(gpu->device, &info, NULL, &timer.pool), error);
    if (status == BVHD_OK)
        *ret_timer = timer;
    return status;
}

void gpu_timer_destroy(struct gpu *gpu, struct gpu_timer *timer)
{
    if (!gpu || !timer)
        return;
    gpu->vk.DestroyQueryPool(gpu->device, timer->pool, NULL);
    timer->pool = VK_NULL_HANDLE;
}

void gpu_timer_start(struct gpu *gpu, struct gpu_timer *timer, VkCommandBuffer commands)
{
    if (!timer->pool)
        return;
    gpu->vk.CmdResetQueryPool(commands, timer->pool, 0, TIMER_QUERIES);
    gpu->vk.CmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, timer->pool, 0);
}

void gpu_timer_stop(struct gpu *gpu, struct gpu_timer *timer, VkCommandBuffer commands)
{
    if (timer->pool)
        gpu->vk.CmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, timer->pool, 1);
}

double gpu_timer_seconds(struct gpu *gpu, const struct gpu_timer *timer)
{
    uint64_t ticks[TIMER_QUERIES];
    if (!timer->pool || gpu->vk.GetQueryPoolResults(gpu->device, timer->pool, 0, TIMER_QUERIES, sizeof ticks, ticks,
                                                    sizeof *ticks, VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT))
        return -1;
    return (double)((ticks[1] - ticks[0]) & gpu->timestamp_mask) * gpu->timestamp_ms * 1e-3;
}
