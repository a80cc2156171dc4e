/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer_portable.h"

#include "proto/base/status.h"
#include "client/bvhctl/trace/tracer_device.h"
#include "client/bvhctl/trace/tracer_scene.h"

struct tracer_portable {
    struct tracer_device device; /* its first member */
    struct bvhd_vulkan_scene *scene;
    struct bvhd_tracer *tracer;
    struct bvhd_trace_binding *binding;
    enum tracer_way way;
    /* of the call that is under way */
    uint32_t flags;
    enum bvhd_ray_order order;
};

static enum bvhd_status bind(struct tracer_device *device, uint32_t count, struct bvhd_error *error)
{
    struct tracer_portable *self = (struct tracer_portable *)device;
    const struct bvhd_trace_buffers buffers = {
        .struct_size = sizeof buffers,
        .rays = {device->rays.buffer, 0, device->rays.size},
        .hits = {device->hits.buffer, 0, device->hits.size},
        .max_rays = count,
    };
    return bvhd_tracer_bind(self->tracer, &buffers, &self->binding, error);
}

static void unbind(struct tracer_device *device)
{
    struct tracer_portable *self = (struct tracer_portable *)device;
    bvhd_trace_binding_destroy(self->binding);
    self->binding = NULL;
}

static bool has_flags(const struct ray *rays, uint64_t count)
{
    for (uint64_t i = 0; i < count; i++)
        if (rays[i].flags || !(rays[i].tmin >= 0))
            return true;
    return false;
}

static void prepare(struct tracer_device *device, const struct ray *rays, uint64_t count)
{
    struct tracer_portable *self = (struct tracer_portable *)device;
    self->flags = self->way == TRACER_WAY_QUERY || has_flags(rays, count) ? BVHD_TRACE_RAY_FLAGS : 0;
    self->order = self->way == TRACER_WAY_COHERENT     ? BVHD_RAYS_COHERENT
                  : self->way == TRACER_WAY_INCOHERENT ? BVHD_RAYS_INCOHERENT
                                                       : bvhd_rays_order(rays, count, sizeof *rays);
}

static enum bvhd_status record(struct tracer_device *device, VkCommandBuffer commands, uint32_t count,
                               struct bvhd_error *error)
{
    struct tracer_portable *self = (struct tracer_portable *)device;
    const struct bvhd_trace trace = {
        .struct_size = sizeof trace, .ray_count = count, .flags = self->flags, .order = self->order};
    return bvhd_tracer_record(self->binding, commands, &trace, error);
}

static void release(struct tracer_device *device)
{
    struct tracer_portable *self = (struct tracer_portable *)device;
    bvhd_tracer_destroy(self->tracer);
    bvhd_vulkan_scene_destroy(self->scene);
}

static const struct tracer_device_kind portable_kind = {bind, unbind, prepare, record, release};

void tracer_portable_set_way(struct tracer *tracer, enum tracer_way way)
{
    ((struct tracer_portable *)tracer)->way = way;
}

static enum bvhd_status create_tracer(struct tracer_portable *self, const struct structures *structures,
                                      struct bvhd_error *error)
{
    struct gpu *gpu = self->device.gpu;
    uint32_t flags = gpu->properties.has_buffer_address ? BVHD_VULKAN_SCENE_ADDRESSES : 0;
    enum bvhd_status status = tracer_scene_create(gpu, structures, flags, self->device.memory, &self->scene, error);
    if (status != BVHD_OK)
        return status;
    const struct bvhd_tracer_options options = {
        .struct_size = sizeof options,
        .scene = self->scene,
        .root = structures->has_top ? structures->file_count - 1 : 0,
        .has_shader_float64 = gpu->properties.has_doubles,
    };
    status = bvhd_tracer_create(gpu->library, &gpu->queue, &options, &self->tracer, error);
    if (status == BVHD_NOT_FOUND)
        return bvhd_error_set(error, status, structures->name, "nothing to trace was loaded");
    return status;
}

enum bvhd_status tracer_portable_create(struct gpu *gpu, const struct structures *structures, struct memory *memory,
                                        struct tracer **ret_tracer, struct bvhd_error *error)
{
    if (structures->target != TARGET_PORTABLE)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, structures->name,
                              "%s structures; a compute shader traces portable ones",
                              bvhd_target_name((enum bvhd_target)structures->target));
    struct tracer_portable *self = memory_alloc(memory, sizeof *self);
    if (!self)
        return bvhd_error_no_memory(error, structures->name, "no memory for the tracer");
    *self = (struct tracer_portable){.scene = NULL};
    enum bvhd_status status = tracer_device_init(&self->device, &portable_kind, gpu, memory, error);
    self->device.tracer.target = TARGET_PORTABLE;
    if (status == BVHD_OK)
        status = create_tracer(self, structures, error);
    if (status != BVHD_OK)
        tracer_device_destroy(&self->device);
    else
        *ret_tracer = &self->device.tracer;
    return status;
}
