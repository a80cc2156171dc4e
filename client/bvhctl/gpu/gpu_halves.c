/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/gpu/gpu.h"

#include "client/bvhctl/kernels/probe_halves.h"

enum { BYTES = 256, GROUP = 64 };

static enum bvhd_status run(struct gpu *gpu, struct gpu_kernel *kernel, const struct gpu_buffer *floats,
                            struct bvhd_error *error)
{
    const VkMemoryBarrier memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                    .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                                    .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    VkCommandBuffer commands;
    gpu_kernel_bind(gpu, kernel, &floats, NULL);
    enum bvhd_status status = gpu_begin(gpu, &commands, error);
    if (status)
        return status;
    gpu_kernel_record(gpu, kernel, commands, NULL, BYTES / GROUP);
    gpu->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1,
                               &memory, 0, NULL, 0, NULL);
    return gpu_submit(gpu, commands, error);
}

static bool are_kept(const float (*floats)[2])
{
    for (int byte = 0; byte < BYTES; byte++)
        if (floats[byte][0] != (float)byte * 0x1p-24f || floats[byte][1] != floats[byte][0])
            return false;
    return true;
}

bool gpu_keeps_small_halves(struct gpu *gpu)
{
    const struct gpu_kernel_options options = {
        .code = probe_halves_code, .size = sizeof probe_halves_code, .bindings = 1};
    struct gpu_kernel kernel = {.bindings = 0};
    struct gpu_buffer floats = {.size = 0};
    struct bvhd_error error;
    enum bvhd_status status = gpu_kernel_create(gpu, &options, &kernel, &error);
    if (!status)
        status = gpu_buffer_create(gpu, BYTES * 2 * sizeof(float), VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, GPU_READBACK,
                                   &floats, &error);
    if (!status)
        status = run(gpu, &kernel, &floats, &error);
    bool keeps = !status && are_kept(floats.mapped);
    gpu_buffer_destroy(gpu, &floats);
    gpu_kernel_destroy(gpu, &kernel);
    return keeps;
}
