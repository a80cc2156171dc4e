/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <string.h>

#include "client/argument.h"
#include "client/library.h"
#include "client/vulkan/vulkan_tracer.h"

/*
 * Scratch memory of a ray: its number, and room for one and a half undecided triangles; rays whose triangles find no
 * room are left to the query. For fewer rays than MIN_SCRATCH_RAYS there is as much as for these: a few may need much.
 */
enum { UNDECIDED_SIZE = 16, SCRATCH_EACH = 4 + UNDECIDED_SIZE * 3 / 2, MIN_SCRATCH_RAYS = 1 << 12 };

/* Workgroups of the resolve kernel and the fallback, whatever the number of rays that need them. */
enum { AFTER_GROUPS = 256 };

enum { TERMINATE_ON_FIRST_HIT = 0x4 }; /* RayFlagsKHR */

enum { BINDING_RAYS, BINDING_HITS, BINDING_SCENE, BINDING_SCRATCH, BINDINGS };

_Static_assert(sizeof(struct bvhd_ray) == 48 && sizeof(struct bvhd_hit) == 32, "as kernels declare them");
_Static_assert(sizeof(struct vulkan_trace_counters) == VULKAN_TRACE_HEAD, "as kernels declare them");

struct bvhd_trace_binding {
    const struct bvhd_tracer *tracer;
    struct vulkan_set set;
    struct vulkan_buffer own_scratch; /* without a buffer where the caller has given one */
    struct bvhd_vulkan_span scratch;
    uint32_t max_rays;
};

uint32_t bvhd_tracer_max_rays(const struct bvhd_tracer *tracer)
{
    if (!tracer)
        return 0;
    const struct bvhd_vulkan_device *device = tracer->device;
    uint64_t groups = device->compute.max_groups, bound = device->limits.storage_range / sizeof(struct bvhd_ray);
    if (groups > bound / VULKAN_TRACE_GROUP)
        groups = bound / VULKAN_TRACE_GROUP;
    uint64_t most = groups * VULKAN_TRACE_GROUP;
    return most < INT32_MAX ? (uint32_t)most : INT32_MAX;
}

VkDeviceSize bvhd_tracer_scratch_size(const struct bvhd_tracer *tracer, uint32_t max_rays)
{
    uint64_t rays = max_rays < MIN_SCRATCH_RAYS ? MIN_SCRATCH_RAYS : max_rays;
    return tracer && tracer->has_closest ? VULKAN_TRACE_HEAD + rays * SCRATCH_EACH : 0;
}

/* ---- bindings ---- */

static enum bvhd_status check_span(const struct bvhd_tracer *tracer, const char *name,
                                   const struct bvhd_vulkan_span *span, uint64_t needed, struct bvhd_error *error)
{
    uint64_t alignment = tracer->device->limits.storage_alignment;
    if (!span->buffer)
        return bvhd_error_set(error, BVHD_INVALID, name, "its buffer is VK_NULL_HANDLE");
    if (alignment && span->offset % alignment)
        return bvhd_error_set(error, BVHD_INVALID, name, "its offset is no multiple of %" PRIu64, alignment);
    if (span->size < needed)
        return bvhd_error_set(error, BVHD_INVALID, name, "%" PRIu64 " bytes, but %" PRIu64 " are needed",
                              (uint64_t)span->size, needed);
    return BVHD_OK;
}

static enum bvhd_status check_buffers(const struct bvhd_tracer *tracer, const struct bvhd_trace_buffers *buffers,
                                      struct bvhd_error *error)
{
    enum bvhd_status status =
        argument_check_size(buffers, sizeof *buffers, sizeof *buffers, "buffers", "bvhd_trace_buffers", error);
    if (status != BVHD_OK)
        return status;
    uint64_t count = buffers->max_rays;
    if (count == 0)
        return bvhd_error_set(error, BVHD_INVALID, "buffers.max_rays", "it is 0: there are no rays");
    if (count > bvhd_tracer_max_rays(tracer))
        return bvhd_error_set(error, BVHD_TOO_LARGE, "buffers.max_rays",
                              "%" PRIu64 " rays, the device traces %" PRIu32 " at once", count,
                              bvhd_tracer_max_rays(tracer));
    status = check_span(tracer, "buffers.rays", &buffers->rays, count * sizeof(struct bvhd_ray), error);
    if (status == BVHD_OK)
        status = check_span(tracer, "buffers.hits", &buffers->hits, count * sizeof(struct bvhd_hit), error);
    if (status == BVHD_OK && buffers->scratch.buffer)
        status = check_span(tracer, "buffers.scratch", &buffers->scratch,
                            bvhd_tracer_scratch_size(tracer, buffers->max_rays), error);
    return status;
}

static enum bvhd_status take_scratch(struct bvhd_trace_binding *binding, const struct bvhd_vulkan_span *given,
                                     struct bvhd_error *error)
{
    VkDeviceSize size = bvhd_tracer_scratch_size(binding->tracer, binding->max_rays);
    if (size == 0)
        return BVHD_OK;
    if (given->buffer) {
        binding->scratch = (struct bvhd_vulkan_span){given->buffer, given->offset, size};
        return BVHD_OK;
    }
    enum bvhd_status status = vulkan_buffer_create(
        binding->tracer->device, size, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT,
        VULKAN_DEVICE, &binding->own_scratch, error);
    binding->scratch = (struct bvhd_vulkan_span){binding->own_scratch.buffer, 0, size};
    return status;
}

static void write_set(const struct bvhd_trace_binding *binding, const struct bvhd_trace_buffers *buffers)
{
    const struct bvhd_tracer *tracer = binding->tracer;
    const struct bvhd_vulkan_span *scratch = &binding->scratch;
    const VkDescriptorBufferInfo ranges[BINDINGS] = {
        [BINDING_RAYS] = {buffers->rays.buffer, buffers->rays.offset,
                          (VkDeviceSize)binding->max_rays * sizeof(struct bvhd_ray)},
        [BINDING_HITS] = {buffers->hits.buffer, buffers->hits.offset,
                          (VkDeviceSize)binding->max_rays * sizeof(struct bvhd_hit)},
        [BINDING_SCENE] = {tracer->scene.buffer, 0, tracer->scene.size},
        [BINDING_SCRATCH] = {scratch->buffer, scratch->offset, scratch->size},
    };
    vulkan_set_write(tracer->device, &tracer->layout, &binding->set, ranges, NULL);
}

enum bvhd_status bvhd_tracer_bind(const struct bvhd_tracer *tracer, const struct bvhd_trace_buffers *buffers,
                                  struct bvhd_trace_binding **ret_binding, struct bvhd_error *ret_error)
{
    enum bvhd_status status =
        ARGUMENTS_CHECK(ret_error, {tracer, "tracer"}, {buffers, "buffers"}, {ret_binding, "ret_binding"});
    if (status == BVHD_OK)
        status = check_buffers(tracer, buffers, ret_error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_trace_binding *binding = memory_alloc(&library_memory, sizeof *binding);
    if (!binding)
        return bvhd_error_no_memory(ret_error, "binding", "no memory for %zu bytes", sizeof *binding);
    *binding = (struct bvhd_trace_binding){.tracer = tracer, .max_rays = buffers->max_rays};
    status = take_scratch(binding, &buffers->scratch, ret_error);
    if (status == BVHD_OK)
        status = vulkan_set_create(tracer->device, &tracer->layout, &binding->set, ret_error);
    if (status != BVHD_OK) {
        bvhd_trace_binding_destroy(binding);
        return status;
    }
    write_set(binding, buffers);
    *ret_binding = binding;
    return BVHD_OK;
}

void bvhd_trace_binding_destroy(struct bvhd_trace_binding *binding)
{
    if (!binding)
        return;
    vulkan_set_destroy(binding->tracer->device, &binding->set);
    vulkan_buffer_destroy(binding->tracer->device, &binding->own_scratch);
    memory_free(&library_memory, binding);
}

/* ---- recording ---- */

static void barrier(const struct bvhd_trace_binding *binding, VkCommandBuffer commands, VkPipelineStageFlags from,
                    VkAccessFlags written, VkPipelineStageFlags to, VkAccessFlags read)
{
    const VkMemoryBarrier memory = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER, .srcAccessMask = written, .dstAccessMask = read};
    binding->tracer->device->vk.CmdPipelineBarrier(commands, from, to, 0, 1, &memory, 0, NULL, 0, NULL);
}

static void dispatch(const struct bvhd_trace_binding *binding, VkCommandBuffer commands, VkPipeline pipeline,
                     const struct vulkan_trace_push *push, uint32_t groups)
{
    const struct bvhd_tracer *tracer = binding->tracer;
    vulkan_record_dispatch(tracer->device, commands, &tracer->layout, pipeline, &binding->set, push, groups);
}

/* Records a kernel for the rays that an earlier one has left. If there are none, its threads end at once. */
static void dispatch_after(const struct bvhd_trace_binding *binding, VkCommandBuffer commands, VkPipeline pipeline,
                           const struct vulkan_trace_push *push)
{
    barrier(binding, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_WRITE_BIT,
            VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT);
    dispatch(binding, commands, pipeline, push, AFTER_GROUPS);
}

/* The first barrier waits for earlier records of this binding, which use the same scratch memory. */
static void clear_counters(const struct bvhd_trace_binding *binding, VkCommandBuffer commands)
{
    barrier(binding, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_WRITE_BIT,
            VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT);
    binding->tracer->device->vk.CmdFillBuffer(commands, binding->scratch.buffer, binding->scratch.offset,
                                              VULKAN_TRACE_HEAD, 0);
    barrier(binding, commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT,
            VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT);
}

static void record_closest(const struct bvhd_trace_binding *binding, VkCommandBuffer commands,
                           const struct vulkan_trace_pass *pass, const struct vulkan_trace_push *push, uint32_t groups)
{
    const struct bvhd_tracer *tracer = binding->tracer;
    clear_counters(binding, commands);
    dispatch(binding, commands, pass->pipeline, push,
             pass->max_groups && groups > pass->max_groups ? pass->max_groups : groups);
    if (!pass->resolves)
        dispatch_after(binding, commands, tracer->resolve, push);
    dispatch_after(binding, commands, tracer->fallback, push);
}

static enum bvhd_status check_trace(const struct bvhd_trace_binding *binding, const struct bvhd_trace *trace,
                                    struct bvhd_error *error)
{
    enum bvhd_status status = argument_check_size(trace, sizeof *trace, sizeof *trace, "trace", "bvhd_trace", error);
    if (status != BVHD_OK)
        return status;
    if (trace->flags & ~(uint32_t)(BVHD_TRACE_ANY_HIT | BVHD_TRACE_RAY_FLAGS))
        return bvhd_error_set(error, BVHD_INVALID, "trace.flags", "0x%" PRIx32 " has bits that are no BVHD_TRACE_ flag",
                              trace->flags);
    if ((uint32_t)trace->order > BVHD_RAYS_INCOHERENT)
        return bvhd_error_set(error, BVHD_INVALID, "trace.order", "%" PRIu32 " is no value of enum bvhd_ray_order",
                              (uint32_t)trace->order);
    if (trace->ray_count > binding->max_rays)
        return bvhd_error_set(error, BVHD_INVALID, "trace.ray_count", "%" PRIu32 " rays, but the binding has %" PRIu32,
                              trace->ray_count, binding->max_rays);
    return BVHD_OK;
}

enum bvhd_status bvhd_tracer_record(const struct bvhd_trace_binding *binding, VkCommandBuffer commands,
                                    const struct bvhd_trace *trace, struct bvhd_error *ret_error)
{
    enum bvhd_status status =
        ARGUMENTS_CHECK(ret_error, {binding, "binding"}, {commands, "commands"}, {trace, "trace"});
    if (status == BVHD_OK)
        status = check_trace(binding, trace, ret_error);
    if (status != BVHD_OK || trace->ray_count == 0)
        return status;
    const struct bvhd_tracer *tracer = binding->tracer;
    const struct vulkan_trace_scene *scene = &tracer->scene;
    const struct vulkan_trace_push push = {
        .count = trace->ray_count,
        .has_top = scene->has_top,
        .root = {(uint32_t)scene->root, (uint32_t)(scene->root >> 32)},
        .scene_base = {(uint32_t)scene->base, (uint32_t)(scene->base >> 32)},
        .ray_flags = trace->flags & BVHD_TRACE_ANY_HIT ? TERMINATE_ON_FIRST_HIT : 0,
    };
    uint32_t groups = (trace->ray_count + VULKAN_TRACE_GROUP - 1) / VULKAN_TRACE_GROUP;
    if (!tracer->has_closest || trace->flags & BVHD_TRACE_RAY_FLAGS)
        dispatch(binding, commands, tracer->query, &push, groups);
    else
        record_closest(binding, commands, trace->order == BVHD_RAYS_COHERENT ? &tracer->coherent : &tracer->incoherent,
                       &push, groups);
    return BVHD_OK;
}

/* ---- the order of rays ---- */

/*
 * Rays are coherent if most directions of neighbours, at some places of the buffer, enclose an angle of this cosine or
 * more.
 */
enum { NEIGHBOURS = 32, PLACES = 64 };
static const float coherent_cosine = 0.9f;

static void read_direction(const void *rays, size_t stride, uint64_t index, float *ret_direction)
{
    memcpy(ret_direction, (const char *)rays + index * stride + offsetof(struct bvhd_ray, direction),
           3 * sizeof(float));
}

static float dot(const float *a, const float *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static bool is_along(const float *a, const float *b)
{
    float cosine = dot(a, b);
    return cosine > 0 && cosine * cosine >= coherent_cosine * coherent_cosine * dot(a, a) * dot(b, b);
}

enum bvhd_ray_order bvhd_rays_order(const void *rays, uint64_t count, size_t stride)
{
    if (!rays || stride < offsetof(struct bvhd_ray, direction) + 3 * sizeof(float))
        return BVHD_RAYS_UNKNOWN;
    uint64_t step = count / PLACES < NEIGHBOURS ? NEIGHBOURS : count / PLACES / NEIGHBOURS * NEIGHBOURS;
    uint64_t along = 0, all = 0;
    for (uint64_t at = 0; at < count; at += step) {
        float first[3], other[3];
        read_direction(rays, stride, at, first);
        for (uint64_t i = at + 1; i < count && i < at + NEIGHBOURS; i++, all++) {
            read_direction(rays, stride, i, other);
            along += is_along(first, other);
        }
    }
    return along >= all - all / 4 ? BVHD_RAYS_COHERENT : BVHD_RAYS_INCOHERENT;
}
