/* SPDX-License-Identifier: Apache-2.0 */
#include <stdint.h>
#include <string.h>

#include "status.h"
#include "tracer_device.h"

#include "trace_query.h"

enum { BINDING_BOXES = 2, BINDING_FIRST, BINDINGS };

struct tracer_query {
    struct tracer_device device; /* its first member */
    VkAccelerationStructureKHR top;
    struct gpu_buffer boxes, first;
};

static void release(struct tracer_device *device)
{
    struct tracer_query *self = (struct tracer_query *)device;
    gpu_buffer_destroy(device->gpu, &self->boxes);
    gpu_buffer_destroy(device->gpu, &self->first);
}

/* A buffer that shaders read and the host fills once. */
static enum bvhd_status put(struct gpu *gpu, const void *data, uint64_t size, struct gpu_buffer *ret_buffer, struct bvhd_error *error)
{
    enum bvhd_status status = gpu_buffer_create(gpu, size, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, GPU_UPLOAD, ret_buffer, error);
    if (!status)
        memcpy(ret_buffer->mapped, data, size);
    return status;
}

static enum bvhd_status set_boxes(struct tracer_query *self, const struct tracer_boxes *boxes, struct bvhd_error *error)
{
    struct gpu *gpu = self->device.gpu;
    struct gpu_buffer rows = {.size = 0}, first = {.size = 0};
    uint64_t firsts = (uint64_t)boxes->instance_count * boxes->geometry_stride;
    enum bvhd_status status = put(gpu, boxes->boxes, (uint64_t)boxes->box_count * 6 * sizeof(float), &rows, error);
    if (!status)
        status = put(gpu, boxes->first, firsts * sizeof(uint32_t), &first, error);
    if (status) {
        gpu_buffer_destroy(gpu, &rows);
        return status;
    }
    release(&self->device);
    self->boxes = rows;
    self->first = first;
    self->device.push.extra[0] = boxes->geometry_stride;
    tracer_device_rebind(&self->device);
    return BVHD_OK;
}

enum bvhd_status tracer_query_set_boxes(struct tracer *tracer, const struct tracer_boxes *boxes, struct bvhd_error *error)
{
    return set_boxes((struct tracer_query *)tracer, boxes, error);
}

enum bvhd_status tracer_query_create(struct gpu *gpu, VkAccelerationStructureKHR top, struct memory *memory, struct tracer **ret_tracer,
                                     struct bvhd_error *error)
{
    static const float no_box[6];
    static const uint32_t no_first, constants[] = {TRACER_GROUP};
    const struct tracer_boxes none = {.boxes = no_box, .box_count = 1, .instance_count = 1, .geometry_stride = 1, .first = &no_first};
    const struct gpu_kernel_options kernel = {.code = trace_query_code,
                                              .size = sizeof trace_query_code,
                                              .bindings = BINDINGS,
                                              .structures = 1,
                                              .constants = constants,
                                              .constant_count = 1};
    if (!gpu->facts.has_ray_query)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, gpu->facts.name, "has no ray queries (VK_KHR_ray_query)");
    struct tracer_query *self = memory_alloc(memory, sizeof *self);
    if (!self)
        return bvhd_error_set(error, BVHD_NO_MEMORY, gpu->facts.name, "no memory for the tracer");
    *self = (struct tracer_query){.top = top};
    enum bvhd_status status = tracer_device_init(&self->device, gpu, &kernel, memory, error);
    if (status) {
        memory_free(memory, self);
        return status;
    }
    self->device.release = release;
    self->device.push.has_top = 1;
    self->device.structures = &self->top;
    self->device.buffers[0] = &self->boxes;
    self->device.buffers[1] = &self->first;
    status = set_boxes(self, &none, error);
    self->device.push.extra[0] = 0;
    if (status)
        tracer_device_destroy(&self->device);
    else
        *ret_tracer = &self->device.tracer;
    return status;
}
