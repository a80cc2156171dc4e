/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/gpu/gpu.h"
#include "proto/base/status.h"

static enum bvhd_status create(struct gpu *gpu, const struct gpu_kernel_options *options, struct gpu_kernel *kernel,
                               struct bvhd_error *error)
{
    const struct vulkan_code code = {.words = options->code,
                                     .size = options->size,
                                     .constants = options->constants,
                                     .constant_count = options->constant_count};
    enum bvhd_status status = vulkan_layout_create(gpu->library, options->bindings, options->structures,
                                                   options->push_size, &kernel->layout, error);
    if (status == BVHD_OK)
        status = vulkan_pipeline_create(gpu->library, &kernel->layout, VK_NULL_HANDLE, &code, &kernel->pipeline, error);
    return status != BVHD_OK ? status : vulkan_set_create(gpu->library, &kernel->layout, &kernel->set, error);
}

enum bvhd_status gpu_kernel_create(struct gpu *gpu, const struct gpu_kernel_options *options,
                                   struct gpu_kernel *ret_kernel, struct bvhd_error *error)
{
    struct gpu_kernel kernel = {.pipeline = VK_NULL_HANDLE};
    enum bvhd_status status = create(gpu, options, &kernel, error);
    if (status != BVHD_OK)
        gpu_kernel_destroy(gpu, &kernel);
    else
        *ret_kernel = kernel;
    return status;
}

void gpu_kernel_destroy(struct gpu *gpu, struct gpu_kernel *kernel)
{
    if (!gpu || !kernel)
        return;
    vulkan_set_destroy(gpu->library, &kernel->set);
    vulkan_pipeline_destroy(gpu->library, kernel->pipeline);
    vulkan_layout_destroy(gpu->library, &kernel->layout);
    kernel->pipeline = VK_NULL_HANDLE;
}

void gpu_kernel_bind(struct gpu *gpu, struct gpu_kernel *kernel, const struct gpu_buffer *const *buffers,
                     const VkAccelerationStructureKHR *structures)
{
    VkDescriptorBufferInfo ranges[VULKAN_MAX_BINDINGS];
    for (uint32_t i = 0; i < kernel->layout.buffers; i++)
        ranges[i] = (VkDescriptorBufferInfo){buffers[i]->buffer, 0, buffers[i]->size};
    vulkan_set_write(gpu->library, &kernel->layout, &kernel->set, ranges, structures);
}

void gpu_kernel_record(struct gpu *gpu, const struct gpu_kernel *kernel, VkCommandBuffer commands, const void *push,
                       uint32_t groups)
{
    vulkan_record_dispatch(gpu->library, commands, &kernel->layout, kernel->pipeline, &kernel->set, push, groups);
}
