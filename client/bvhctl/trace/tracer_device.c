/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer_device.h"

#include <string.h>

#include "proto/base/clock.h"
#include "client/bvhctl/trace/device_ray.h"
#include "proto/base/status.h"

_Static_assert(sizeof(struct tracer_hit) == sizeof(struct bvhd_hit), "as kernels have them");

static void free_buffers(struct tracer_device *self)
{
    self->kind->unbind(self);
    gpu_buffer_destroy(self->gpu, &self->upload);
    gpu_buffer_destroy(self->gpu, &self->rays);
    gpu_buffer_destroy(self->gpu, &self->hits);
    gpu_buffer_destroy(self->gpu, &self->readback);
    self->capacity = 0;
}

static enum bvhd_status create_buffers(struct tracer_device *self, uint32_t count, struct bvhd_error *error)
{
    const VkBufferUsageFlags from = VK_BUFFER_USAGE_TRANSFER_SRC_BIT, to = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    const VkBufferUsageFlags bound = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
    uint64_t rays = (uint64_t)count * sizeof(struct bvhd_ray), hits = (uint64_t)count * sizeof(struct tracer_hit);
    enum bvhd_status status = gpu_buffer_create(self->gpu, rays, from, GPU_UPLOAD, &self->upload, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(self->gpu, rays, bound | to, GPU_DEVICE, &self->rays, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(self->gpu, hits, bound | from, GPU_DEVICE, &self->hits, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(self->gpu, hits, to, GPU_READBACK, &self->readback, error);
    return status;
}

/* Creates and binds the buffers for a portion of `count` rays. */
static enum bvhd_status reserve(struct tracer_device *self, uint32_t count, struct bvhd_error *error)
{
    if (count <= self->capacity)
        return BVHD_OK;
    free_buffers(self);
    enum bvhd_status status = create_buffers(self, count, error);
    if (status == BVHD_OK)
        status = self->kind->bind(self, count, error);
    if (status != BVHD_OK)
        free_buffers(self);
    else
        self->capacity = count;
    return status;
}

static void barrier(struct gpu *gpu, VkCommandBuffer commands, VkPipelineStageFlags from, VkAccessFlags written,
                    VkPipelineStageFlags to, VkAccessFlags read)
{
    const VkMemoryBarrier memory = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER, .srcAccessMask = written, .dstAccessMask = read};
    gpu->vk.CmdPipelineBarrier(commands, from, to, 0, 1, &memory, 0, NULL, 0, NULL);
}

static void copy_back(struct tracer_device *self, VkCommandBuffer commands, uint32_t count)
{
    struct gpu *gpu = self->gpu;
    const VkBufferCopy hits = {.size = (VkDeviceSize)count * sizeof(struct tracer_hit)};
    barrier(gpu, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_WRITE_BIT,
            VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_READ_BIT);
    gpu->vk.CmdCopyBuffer(commands, self->hits.buffer, self->readback.buffer, 1, &hits);
    barrier(gpu, commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT, VK_PIPELINE_STAGE_HOST_BIT,
            VK_ACCESS_HOST_READ_BIT);
}

static enum bvhd_status record(struct tracer_device *self, VkCommandBuffer commands, uint32_t count,
                               struct bvhd_error *error)
{
    struct gpu *gpu = self->gpu;
    const VkBufferCopy up = {.size = (VkDeviceSize)count * sizeof(struct bvhd_ray)};
    gpu->vk.CmdCopyBuffer(commands, self->upload.buffer, self->rays.buffer, 1, &up);
    barrier(gpu, commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT,
            VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_READ_BIT);
    gpu_timer_start(gpu, &self->timer, commands);
    enum bvhd_status status = self->kind->record(self, commands, count, error);
    gpu_timer_stop(gpu, &self->timer, commands);
    copy_back(self, commands, count);
    return status;
}

/* Without timestamps the wall clock has to do: what copies take is in it then. */
static enum bvhd_status submit(struct tracer_device *self, VkCommandBuffer commands, double *seconds,
                               struct bvhd_error *error)
{
    uint64_t began = clock_ns();
    enum bvhd_status status = gpu_submit(self->gpu, commands, error);
    if (status != BVHD_OK)
        return status;
    double measured = gpu_timer_seconds(self->gpu, &self->timer);
    *seconds += measured >= 0 ? measured : (double)(clock_ns() - began) * 1e-9;
    return BVHD_OK;
}

static enum bvhd_status trace_portion(struct tracer_device *self, const struct ray *rays, uint32_t count,
                                      struct tracer_hit *ret_hits, double *seconds, struct bvhd_error *error)
{
    VkCommandBuffer commands;
    device_rays_put(rays, count, self->upload.mapped);
    enum bvhd_status status = gpu_begin(self->gpu, &commands, error);
    if (status != BVHD_OK)
        return status;
    enum bvhd_status recorded = record(self, commands, count, error);
    status = submit(self, commands, seconds, recorded != BVHD_OK ? NULL : error);
    status = recorded != BVHD_OK ? recorded : status;
    if (status == BVHD_OK)
        memcpy(ret_hits, self->readback.mapped, count * sizeof *ret_hits);
    return status;
}

/* How many rays a dispatch takes: workgroups, and bytes that can be bound, are limited. */
static uint64_t portion_of(const struct gpu_properties *properties)
{
    uint64_t most = (uint64_t)properties->max_groups * TRACER_GROUP,
             bound = properties->max_storage_range / sizeof(struct bvhd_ray);
    if (most > bound)
        most = bound / TRACER_GROUP * TRACER_GROUP;
    return most < TRACER_PORTION ? most : TRACER_PORTION;
}

static enum bvhd_status trace(struct tracer *tracer, const struct ray *rays, uint64_t count,
                              struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    struct tracer_device *self = (struct tracer_device *)tracer;
    if (self->kind->prepare)
        self->kind->prepare(self, rays, count);
    double seconds = 0;
    uint64_t most = portion_of(&self->gpu->properties);
    enum bvhd_status status = count ? reserve(self, (uint32_t)(count < most ? count : most), error) : BVHD_OK;
    for (uint64_t at = 0; at < count && status == BVHD_OK; at += most) {
        uint64_t portion = count - at < most ? count - at : most;
        status = trace_portion(self, rays + at, (uint32_t)portion, ret_hits + at, &seconds, error);
    }
    if (status == BVHD_OK && ret_seconds)
        *ret_seconds = seconds;
    return status;
}

static void destroy(struct tracer *tracer)
{
    tracer_device_destroy((struct tracer_device *)tracer);
}

enum bvhd_status tracer_device_init(struct tracer_device *self, const struct tracer_device_kind *kind, struct gpu *gpu,
                                    struct memory *memory, struct bvhd_error *error)
{
    *self = (struct tracer_device){.kind = kind, .gpu = gpu, .memory = memory};
    self->tracer = (struct tracer){.device = gpu->properties.name, .trace = trace, .destroy = destroy};
    return gpu_timer_create(gpu, &self->timer, error);
}

void tracer_device_destroy(struct tracer_device *self)
{
    if (!self)
        return;
    free_buffers(self);
    self->kind->release(self);
    gpu_timer_destroy(self->gpu, &self->timer);
    memory_free(self->memory, self);
}
