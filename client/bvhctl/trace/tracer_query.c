/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer_query.h"

#include <stdint.h>

#include "proto/base/status.h"
#include "client/bvhctl/trace/tracer_device.h"

#include "client/bvhctl/kernels/trace_native.h"

/* As bvhd_trace_rays.glsl declares it. */
struct push {
    uint32_t count, has_top;
    uint32_t unused[5];
};

struct tracer_query {
    struct tracer_device device; /* its first member */
    struct gpu_kernel kernel;
    VkAccelerationStructureKHR top;
    bool has_top;
};

static enum bvhd_status bind(struct tracer_device *device, uint32_t count, struct bvhd_error *error)
{
    struct tracer_query *self = (struct tracer_query *)device;
    const struct gpu_buffer *buffers[] = {&device->rays, &device->hits};
    (void)count;
    (void)error;
    gpu_kernel_bind(device->gpu, &self->kernel, buffers, &self->top);
    return BVHD_OK;
}

static void unbind(struct tracer_device *device)
{
    (void)device;
}

static enum bvhd_status record(struct tracer_device *device, VkCommandBuffer commands, uint32_t count,
                               struct bvhd_error *error)
{
    struct tracer_query *self = (struct tracer_query *)device;
    const struct push push = {.count = count, .has_top = self->has_top};
    (void)error;
    gpu_kernel_record(device->gpu, &self->kernel, commands, &push, (count + TRACER_GROUP - 1) / TRACER_GROUP);
    return BVHD_OK;
}

static void release(struct tracer_device *device)
{
    gpu_kernel_destroy(device->gpu, &((struct tracer_query *)device)->kernel);
}

static const struct tracer_device_kind query_kind = {bind, unbind, NULL, record, release};

void tracer_query_set_top(struct tracer *tracer, bool has_top)
{
    ((struct tracer_query *)tracer)->has_top = has_top;
}

enum bvhd_status tracer_query_create(struct gpu *gpu, VkAccelerationStructureKHR top, struct memory *memory,
                                     struct tracer **ret_tracer, struct bvhd_error *error)
{
    static const uint32_t constants[] = {TRACER_GROUP};
    const struct gpu_kernel_options kernel = {.code = trace_native_code,
                                              .size = sizeof trace_native_code,
                                              .bindings = 2,
                                              .structures = 1,
                                              .push_size = sizeof(struct push),
                                              .constants = constants,
                                              .constant_count = 1};
    if (!gpu->properties.has_ray_query)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, gpu->properties.name, "has no ray queries (VK_KHR_ray_query)");
    struct tracer_query *self = memory_alloc(memory, sizeof *self);
    if (!self)
        return bvhd_error_no_memory(error, gpu->properties.name, "no memory for the tracer");
    *self = (struct tracer_query){.top = top, .has_top = true};
    enum bvhd_status status = tracer_device_init(&self->device, &query_kind, gpu, memory, error);
    if (status == BVHD_OK)
        status = gpu_kernel_create(gpu, &kernel, &self->kernel, error);
    if (status != BVHD_OK)
        tracer_device_destroy(&self->device);
    else
        *ret_tracer = &self->device.tracer;
    return status;
}
