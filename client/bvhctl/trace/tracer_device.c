/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer_device.h"

#include <string.h>

#include "proto/base/clock.h"
#include "client/bvhctl/trace/device_ray.h"
#include "proto/base/status.h"

/* The head of the work buffer; for how many rays there is one at least: a few may need much. */
enum { WORK_HEAD = 16, WORK_LEFT = 1, LEAST_WORK = 1 << 12 };

_Static_assert(sizeof(struct tracer_hit) == 32, "as kernels have them");

static void free_buffers(struct tracer_device *self)
{
    gpu_buffer_destroy(self->gpu, &self->upload);
    gpu_buffer_destroy(self->gpu, &self->rays);
    gpu_buffer_destroy(self->gpu, &self->hits);
    gpu_buffer_destroy(self->gpu, &self->work);
    gpu_buffer_destroy(self->gpu, &self->readback);
    self->capacity = 0;
}

static enum bvhd_status create_buffers(struct tracer_device *self, uint32_t count, struct bvhd_error *error)
{
    const VkBufferUsageFlags from = VK_BUFFER_USAGE_TRANSFER_SRC_BIT, to = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    const VkBufferUsageFlags bound = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
    uint64_t rays = (uint64_t)count * sizeof(struct device_ray), hits = (uint64_t)count * sizeof(struct tracer_hit);
    enum bvhd_status status = gpu_buffer_create(self->gpu, rays, from, GPU_UPLOAD, &self->upload, error);
    if (!status)
        status = gpu_buffer_create(self->gpu, rays, bound | to, GPU_DEVICE, &self->rays, error);
    if (!status)
        status = gpu_buffer_create(self->gpu, hits, bound | from, GPU_DEVICE, &self->hits, error);
    if (!status && self->work_binding)
        status = gpu_buffer_create(self->gpu,
                                   WORK_HEAD + (uint64_t)(count < LEAST_WORK ? LEAST_WORK : count) * self->work_each,
                                   bound | from | to, GPU_DEVICE, &self->work, error);
    if (!status)
        status = gpu_buffer_create(self->gpu, hits + WORK_HEAD, to, GPU_READBACK, &self->readback, error);
    if (status)
        free_buffers(self);
    return status;
}

/* Buffers for a portion of so many rays, bound. */
static enum bvhd_status reserve(struct tracer_device *self, uint32_t count, struct bvhd_error *error)
{
    if (count <= self->capacity)
        return BVHD_OK;
    free_buffers(self);
    enum bvhd_status status = create_buffers(self, count, error);
    if (status)
        return status;
    const struct gpu_buffer *bound[TRACER_BINDINGS] = {&self->rays, &self->hits};
    for (uint32_t i = 2; i < TRACER_BINDINGS; i++)
        bound[i] = i == self->work_binding ? &self->work : self->buffers[i - 2];
    gpu_kernel_bind(self->gpu, &self->kernel, bound, self->structures);
    for (uint32_t i = 0; i < self->choice_count; i++)
        gpu_kernel_bind(self->gpu, &self->choices[i].kernel, bound, self->structures);
    if (self->choice_count) {
        gpu_kernel_bind(self->gpu, &self->after, bound, self->structures);
        gpu_kernel_bind(self->gpu, &self->rest, bound, self->structures);
    }
    self->capacity = count;
    return BVHD_OK;
}

static void barrier(struct gpu *gpu, VkCommandBuffer commands, VkPipelineStageFlags from, VkAccessFlags written,
                    VkPipelineStageFlags to, VkAccessFlags read)
{
    const VkMemoryBarrier memory = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER, .srcAccessMask = written, .dstAccessMask = read};
    gpu->vk.CmdPipelineBarrier(commands, from, to, 0, 1, &memory, 0, NULL, 0, NULL);
}

static void dispatch_after(struct tracer_device *self, VkCommandBuffer commands, const struct gpu_kernel *kernel)
{
    barrier(self->gpu, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_WRITE_BIT,
            VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT);
    gpu_kernel_record(self->gpu, kernel, commands, &self->push, TRACER_AFTER_GROUPS);
}

static void dispatch(struct tracer_device *self, VkCommandBuffer commands, uint32_t count,
                     const struct tracer_device_choice *choice)
{
    uint32_t groups = (count + TRACER_GROUP - 1) / TRACER_GROUP;
    if (choice && choice->most_groups && groups > choice->most_groups)
        groups = choice->most_groups;
    gpu_kernel_record(self->gpu, choice ? &choice->kernel : &self->kernel, commands, &self->push, groups);
    if (choice && !choice->is_whole)
        dispatch_after(self, commands, &self->after);
}

static void copy_back(struct tracer_device *self, VkCommandBuffer commands, uint32_t count)
{
    struct gpu *gpu = self->gpu;
    const VkBufferCopy hits = {.size = (VkDeviceSize)count * sizeof(struct tracer_hit)};
    const VkBufferCopy head = {.dstOffset = hits.size, .size = WORK_HEAD};
    barrier(gpu, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_WRITE_BIT,
            VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_READ_BIT);
    gpu->vk.CmdCopyBuffer(commands, self->hits.buffer, self->readback.buffer, 1, &hits);
    if (self->work_binding)
        gpu->vk.CmdCopyBuffer(commands, self->work.buffer, self->readback.buffer, 1, &head);
    barrier(gpu, commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT, VK_PIPELINE_STAGE_HOST_BIT,
            VK_ACCESS_HOST_READ_BIT);
}

static void record(struct tracer_device *self, VkCommandBuffer commands, uint32_t count,
                   const struct tracer_device_choice *choice)
{
    struct gpu *gpu = self->gpu;
    const VkBufferCopy up = {.size = (VkDeviceSize)count * sizeof(struct device_ray)};
    self->push.count = count;
    gpu->vk.CmdCopyBuffer(commands, self->upload.buffer, self->rays.buffer, 1, &up);
    if (self->work_binding)
        gpu->vk.CmdFillBuffer(commands, self->work.buffer, 0, WORK_HEAD, 0);
    barrier(gpu, commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT,
            VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT);
    gpu_timer_start(gpu, &self->timer, commands);
    dispatch(self, commands, count, choice);
    gpu_timer_stop(gpu, &self->timer, commands);
    copy_back(self, commands, count);
}

/* Without timestamps the wall clock has to do: what copies take is in it then. */
static enum bvhd_status submit(struct tracer_device *self, VkCommandBuffer commands, double *seconds,
                               struct bvhd_error *error)
{
    uint64_t began = clock_ns();
    enum bvhd_status status = gpu_submit(self->gpu, commands, error);
    if (status)
        return status;
    double measured = gpu_timer_seconds(self->gpu, &self->timer);
    *seconds += measured >= 0 ? measured : (double)(clock_ns() - began) * 1e-9;
    return BVHD_OK;
}

static bool has_left_rays(const struct tracer_device *self, uint32_t count)
{
    const struct tracer_hit *hits = self->readback.mapped;
    return self->work_binding && ((const uint32_t *)(const void *)(hits + count))[WORK_LEFT];
}

static enum bvhd_status trace_left(struct tracer_device *self, uint32_t count, double *seconds,
                                   struct bvhd_error *error)
{
    VkCommandBuffer commands;
    enum bvhd_status status = gpu_begin(self->gpu, &commands, error);
    if (status)
        return status;
    gpu_timer_start(self->gpu, &self->timer, commands);
    dispatch_after(self, commands, &self->rest);
    gpu_timer_stop(self->gpu, &self->timer, commands);
    copy_back(self, commands, count);
    return submit(self, commands, seconds, error);
}

static enum bvhd_status trace_portion(struct tracer_device *self, const struct tracer_device_choice *choice,
                                      const struct ray *rays, uint32_t count, struct tracer_hit *ret_hits,
                                      double *seconds, struct bvhd_error *error)
{
    VkCommandBuffer commands;
    device_rays_put(rays, count, self->upload.mapped);
    enum bvhd_status status = gpu_begin(self->gpu, &commands, error);
    if (status)
        return status;
    record(self, commands, count, choice);
    status = submit(self, commands, seconds, error);
    if (!status && choice && has_left_rays(self, count))
        status = trace_left(self, count, seconds, error);
    if (!status)
        memcpy(ret_hits, self->readback.mapped, count * sizeof *ret_hits);
    return status;
}

/* How many rays a dispatch takes: workgroups, and bytes that can be bound, are limited. */
static uint64_t portion_of(const struct gpu_properties *properties)
{
    uint64_t most = (uint64_t)properties->max_groups * TRACER_GROUP,
             bound = properties->max_storage_range / sizeof(struct device_ray);
    if (most > bound)
        most = bound / TRACER_GROUP * TRACER_GROUP;
    return most < TRACER_PORTION ? most : TRACER_PORTION;
}

static enum bvhd_status trace(struct tracer *tracer, const struct ray *rays, uint64_t count,
                              struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    struct tracer_device *self = (struct tracer_device *)tracer;
    int place = self->choose ? self->choose(self, rays, count) : -1;
    const struct tracer_device_choice *choice = place < 0 ? NULL : &self->choices[place];
    double seconds = 0;
    uint64_t most = portion_of(&self->gpu->properties);
    enum bvhd_status status = count ? reserve(self, (uint32_t)(count < most ? count : most), error) : BVHD_OK;
    for (uint64_t at = 0; at < count && !status; at += most) {
        uint64_t portion = count - at < most ? count - at : most;
        status = trace_portion(self, choice, rays + at, (uint32_t)portion, ret_hits + at, &seconds, error);
    }
    if (!status && ret_seconds)
        *ret_seconds = seconds;
    return status;
}

static void destroy(struct tracer *tracer)
{
    tracer_device_destroy((struct tracer_device *)tracer);
}

static enum bvhd_status create_kernel(struct tracer_device *self, const struct gpu_kernel_options *options,
                                      struct gpu_kernel *ret_kernel, struct bvhd_error *error)
{
    struct gpu_kernel_options with_push = *options;
    with_push.push_size = sizeof(struct tracer_push);
    return gpu_kernel_create(self->gpu, &with_push, ret_kernel, error);
}

enum bvhd_status tracer_device_init(struct tracer_device *self, struct gpu *gpu,
                                    const struct gpu_kernel_options *options, struct memory *memory,
                                    struct bvhd_error *error)
{
    *self = (struct tracer_device){.gpu = gpu, .memory = memory};
    enum bvhd_status status = create_kernel(self, options, &self->kernel, error);
    if (status)
        return status;
    status = gpu_timer_create(gpu, &self->timer, error);
    if (status) {
        gpu_kernel_destroy(gpu, &self->kernel);
        return status;
    }
    self->tracer = (struct tracer){.device = gpu->properties.name, .trace = trace, .destroy = destroy};
    return BVHD_OK;
}

enum bvhd_status tracer_device_add(struct tracer_device *self, const struct gpu_kernel_options *options,
                                   uint32_t most_groups, struct bvhd_error *error)
{
    struct tracer_device_choice choice = {.most_groups = most_groups};
    enum bvhd_status status = create_kernel(self, options, &choice.kernel, error);
    if (!status)
        self->choices[self->choice_count++] = choice;
    return status;
}

enum bvhd_status tracer_device_add_after(struct tracer_device *self, const struct gpu_kernel_options *options,
                                         struct bvhd_error *error)
{
    return create_kernel(self, options, &self->after, error);
}

enum bvhd_status tracer_device_add_rest(struct tracer_device *self, const struct gpu_kernel_options *options,
                                        struct bvhd_error *error)
{
    return create_kernel(self, options, &self->rest, error);
}

void tracer_device_destroy(struct tracer_device *self)
{
    if (!self)
        return;
    if (self->release)
        self->release(self);
    free_buffers(self);
    gpu_timer_destroy(self->gpu, &self->timer);
    gpu_kernel_destroy(self->gpu, &self->kernel);
    gpu_kernel_destroy(self->gpu, &self->after);
    gpu_kernel_destroy(self->gpu, &self->rest);
    for (uint32_t i = 0; i < self->choice_count; i++)
        gpu_kernel_destroy(self->gpu, &self->choices[i].kernel);
    memory_free(self->memory, self);
}
