/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bench_vulkan_kernel.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/trace/device_ray.h"
#include "client/bvhctl/base/files.h"

enum { MAX_RAYS = 1 << 22, MAX_CONSTANTS = 16, BINDINGS = 4, SECOND_GROUPS = 1056 };

/* Binding 3: words that are 0, followed by as much working memory as bvhctl's own kernels need. */
enum { WORK_WORDS = 64, WORK_EACH = 28 };

struct push {
    uint32_t count, has_top;
    uint64_t root, base;
};

/* One dispatch. */
struct pass {
    char file[4096];
    uint32_t constants[MAX_CONSTANTS], constant_count;
    struct gpu_kernel kernel;
};

struct bench_kernel {
    struct tracer tracer;
    struct gpu *gpu;
    struct memory *memory;
    char name[64];
    struct pass passes[2]; /* the second one has no file if there is only one */
    struct gpu_timer timer;
    struct bvhd_vulkan_scene *scene;
    struct gpu_buffer rays, hits, upload, readback, counter, storage; /* the last one belongs to the scene */
    struct push push;
    uint64_t most_rays; /* in one dispatch */
};

static void parse_pass(const char *text, size_t length, struct pass *pass)
{
    const char *colon = memchr(text, ':', length), *end = text + length;
    memcpy(pass->file, text, colon ? (size_t)(colon - text) : length);
    pass->constants[0] = 64;
    pass->constant_count = 2;
    for (uint32_t i = 0; colon && i < MAX_CONSTANTS; i++) {
        pass->constants[i] = (uint32_t)strtoul(colon + 1, NULL, 0);
        pass->constant_count = i < 2 ? 2 : i + 1;
        colon = memchr(colon + 1, ',', (size_t)(end - colon - 1));
    }
}

static enum bvhd_status parse(struct bench_kernel *self, const char *text, struct bvhd_error *error)
{
    const char *equals = strchr(text, '='), *plus = equals ? strchr(equals, '+') : NULL;
    if (!equals || (size_t)(equals - text) >= sizeof self->name || strlen(equals) >= sizeof self->passes[0].file)
        return bvhd_error_set(error, BVHD_INVALID, text, "NAME=FILE.spv:CONSTANT,... is needed");
    memcpy(self->name, text, (size_t)(equals - text));
    parse_pass(equals + 1, plus ? (size_t)(plus - equals - 1) : strlen(equals + 1), &self->passes[0]);
    if (plus)
        parse_pass(plus + 1, strlen(plus + 1), &self->passes[1]);
    return BVHD_OK;
}

static enum bvhd_status load_pass(struct bench_kernel *self, struct pass *pass, bool statistics,
                                  struct bvhd_error *error)
{
    unsigned char *code;
    uint64_t size;
    enum bvhd_status status = files_read(pass->file, 1 << 24, self->memory, &code, &size, error);
    if (status != BVHD_OK)
        return status;
    struct gpu_kernel_options options = {.code = (const uint32_t *)(const void *)code,
                                         .size = size,
                                         .bindings = BINDINGS,
                                         .push_size = sizeof(struct push),
                                         .constants = pass->constants,
                                         .constant_count = pass->constant_count};
    status = gpu_kernel_create(self->gpu, &options, &pass->kernel, error);
    if (status == BVHD_OK && statistics)
        bench_statistics_of(self->gpu, self->name, &options, pass->kernel.layout.pipeline);
    memory_free(self->memory, code);
    return status;
}

static enum bvhd_status load_kernels(struct bench_kernel *self, bool statistics, struct bvhd_error *error)
{
    enum bvhd_status status = load_pass(self, &self->passes[0], statistics, error);
    if (status == BVHD_OK && self->passes[1].file[0])
        status = load_pass(self, &self->passes[1], statistics, error);
    return status;
}

static enum bvhd_status load_scene(struct bench_kernel *self, const struct structures *structures,
                                   struct bvhd_error *error)
{
    struct bvhd_vulkan_bytes *blobs = memory_array(self->memory, structures->file_count, sizeof *blobs);
    if (!blobs)
        return bvhd_error_no_memory(error, self->name, "no memory for the list of structures");
    for (uint32_t i = 0; i < structures->file_count; i++)
        blobs[i] = (struct bvhd_vulkan_bytes){structures->blobs[i].data, structures->blobs[i].size};
    struct bvhd_vulkan_scene_options options = {
        .struct_size = sizeof options,
        .blobs = blobs,
        .blob_count = structures->file_count,
        .flags = self->gpu->properties.has_buffer_address ? BVHD_VULKAN_SCENE_ADDRESSES : 0};
    enum bvhd_status status =
        bvhd_vulkan_scene_create(self->gpu->library, &self->gpu->queue, &options, &self->scene, error);
    memory_free(self->memory, blobs);
    uint32_t root = structures->has_top ? structures->file_count - 1 : 0;
    struct bvhd_vulkan_span span;
    VkDeviceSize size = 0;
    if (status == BVHD_OK)
        status = bvhd_vulkan_scene_storage(self->scene, root, &span, &size);
    if (status != BVHD_OK)
        return status;
    self->storage = (struct gpu_buffer){.buffer = span.buffer, .size = size};
    self->push = (struct push){.has_top = structures->has_top, .root = bvhd_vulkan_scene_location(self->scene, root)};
    if (options.flags) {
        VkBufferDeviceAddressInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, .buffer = span.buffer};
        self->push.base = self->gpu->vk.GetBufferDeviceAddress(self->gpu->device, &info);
    }
    return BVHD_OK;
}

static enum bvhd_status create_buffers(struct bench_kernel *self, struct bvhd_error *error)
{
    const VkBufferUsageFlags bound = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
    const VkBufferUsageFlags from = VK_BUFFER_USAGE_TRANSFER_SRC_BIT, to = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    uint64_t rays = self->most_rays * sizeof(struct bvhd_ray), hits = self->most_rays * sizeof(struct tracer_hit);
    enum bvhd_status status = gpu_buffer_create(self->gpu, rays, from, GPU_UPLOAD, &self->upload, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(self->gpu, rays, bound | to, GPU_DEVICE, &self->rays, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(self->gpu, hits, bound | from, GPU_DEVICE, &self->hits, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(self->gpu, hits, to, GPU_READBACK, &self->readback, error);
    if (status == BVHD_OK)
        status = gpu_buffer_create(self->gpu, WORK_WORDS * 4 + self->most_rays * WORK_EACH, bound | to, GPU_DEVICE,
                                   &self->counter, error);
    if (status == BVHD_OK)
        status = gpu_timer_create(self->gpu, &self->timer, error);
    return status;
}

static void barrier(struct bench_kernel *self, VkCommandBuffer commands)
{
    VkMemoryBarrier memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                              .srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT,
                              .dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT};
    VkPipelineStageFlags stages =
        VK_PIPELINE_STAGE_TRANSFER_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_HOST_BIT;
    self->gpu->vk.CmdPipelineBarrier(commands, stages, stages, 0, 1, &memory, 0, NULL, 0, NULL);
}

static void record(struct bench_kernel *self, VkCommandBuffer commands, uint32_t count)
{
    struct gpu *gpu = self->gpu;
    VkBufferCopy rays = {0, 0, count * sizeof(struct bvhd_ray)}, hits = {0, 0, count * sizeof(struct tracer_hit)};
    const struct pass *pass = &self->passes[0];
    uint32_t groups = pass->constants[1] ? pass->constants[1] : (count + pass->constants[0] - 1) / pass->constants[0];
    self->push.count = count;
    gpu->vk.CmdCopyBuffer(commands, self->upload.buffer, self->rays.buffer, 1, &rays);
    gpu->vk.CmdFillBuffer(commands, self->counter.buffer, 0, WORK_WORDS * sizeof(uint32_t), 0);
    barrier(self, commands);
    gpu_timer_start(gpu, &self->timer, commands);
    gpu_kernel_record(gpu, &pass->kernel, commands, &self->push, groups);
    if (self->passes[1].file[0]) {
        barrier(self, commands);
        gpu_kernel_record(gpu, &self->passes[1].kernel, commands, &self->push, SECOND_GROUPS);
    }
    gpu_timer_stop(gpu, &self->timer, commands);
    barrier(self, commands);
    gpu->vk.CmdCopyBuffer(commands, self->hits.buffer, self->readback.buffer, 1, &hits);
    barrier(self, commands);
}

static enum bvhd_status trace_portion(struct bench_kernel *self, const struct ray *rays, uint32_t count,
                                      struct tracer_hit *ret_hits, double *seconds, struct bvhd_error *error)
{
    VkCommandBuffer commands;
    device_rays_put(rays, count, self->upload.mapped);
    enum bvhd_status status = gpu_begin(self->gpu, &commands, error);
    if (status != BVHD_OK)
        return status;
    record(self, commands, count);
    status = gpu_submit(self->gpu, commands, error);
    if (status != BVHD_OK)
        return status;
    memcpy(ret_hits, self->readback.mapped, count * sizeof *ret_hits);
    *seconds += gpu_timer_seconds(self->gpu, &self->timer);
    return BVHD_OK;
}

static enum bvhd_status trace(struct tracer *tracer, const struct ray *rays, uint64_t count,
                              struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    struct bench_kernel *self = (struct bench_kernel *)tracer;
    double seconds = 0;
    enum bvhd_status status = BVHD_OK;
    for (uint64_t at = 0; at < count && status == BVHD_OK; at += self->most_rays)
        status = trace_portion(self, rays + at, (uint32_t)(count - at < self->most_rays ? count - at : self->most_rays),
                               ret_hits + at, &seconds, error);
    if (status == BVHD_OK && ret_seconds)
        *ret_seconds = seconds;
    return status;
}

static void destroy(struct tracer *tracer)
{
    struct bench_kernel *self = (struct bench_kernel *)tracer;
    struct gpu_buffer *buffers[] = {&self->rays, &self->hits, &self->upload, &self->readback, &self->counter};
    for (size_t i = 0; i < sizeof buffers / sizeof *buffers; i++)
        gpu_buffer_destroy(self->gpu, buffers[i]);
    gpu_timer_destroy(self->gpu, &self->timer);
    for (int i = 0; i < 2; i++)
        if (self->passes[i].kernel.pipeline)
            gpu_kernel_destroy(self->gpu, &self->passes[i].kernel);
    bvhd_vulkan_scene_destroy(self->scene);
    memory_free(self->memory, self);
}

enum bvhd_status bench_kernel_create(struct gpu *gpu, const char *text, bool statistics,
                                     const struct structures *structures, struct memory *memory,
                                     struct tracer **ret_tracer, struct bvhd_error *error)
{
    struct bench_kernel *self = memory_alloc(memory, sizeof *self);
    if (!self)
        return bvhd_error_no_memory(error, text, "no memory");
    *self = (struct bench_kernel){
        .tracer = {.target = TARGET_PORTABLE, .trace = trace, .destroy = destroy}, .gpu = gpu, .memory = memory};
    self->most_rays = gpu->properties.max_storage_range / sizeof(struct bvhd_ray);
    if (self->most_rays > MAX_RAYS)
        self->most_rays = MAX_RAYS;
    enum bvhd_status status = parse(self, text, error);
    if (status == BVHD_OK)
        status = load_kernels(self, statistics, error);
    if (status == BVHD_OK)
        status = load_scene(self, structures, error);
    if (status == BVHD_OK)
        status = create_buffers(self, error);
    if (status != BVHD_OK) {
        destroy(&self->tracer);
        return status;
    }
    const struct gpu_buffer *bound[BINDINGS] = {&self->rays, &self->hits, &self->storage, &self->counter};
    gpu_kernel_bind(gpu, &self->passes[0].kernel, bound, NULL);
    if (self->passes[1].file[0])
        gpu_kernel_bind(gpu, &self->passes[1].kernel, bound, NULL);
    self->tracer.device = self->name;
    *ret_tracer = &self->tracer;
    return BVHD_OK;
}
