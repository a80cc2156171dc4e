/* SPDX-License-Identifier: Apache-2.0 */
#include <stdint.h>

#include "proto/base/status.h"
#include "client/bvhctl/trace/tracer_device.h"

#include "client/bvhctl/kernels/trace_query.h"

enum { BINDINGS = 2 }; /* rays and hits */

struct tracer_query {
    struct tracer_device device; /* its first member */
    VkAccelerationStructureKHR top;
};

enum bvhd_status tracer_query_create(struct gpu *gpu, VkAccelerationStructureKHR top, struct memory *memory,
                                     struct tracer **ret_tracer, struct bvhd_error *error)
{
    static const uint32_t constants[] = {TRACER_GROUP};
    const struct gpu_kernel_options kernel = {.code = trace_query_code,
                                              .size = sizeof trace_query_code,
                                              .bindings = BINDINGS,
                                              .structures = 1,
                                              .constants = constants,
                                              .constant_count = 1};
    if (!gpu->properties.has_ray_query)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, gpu->properties.name, "has no ray queries (VK_KHR_ray_query)");
    struct tracer_query *self = memory_alloc(memory, sizeof *self);
    if (!self)
        return bvhd_error_no_memory(error, gpu->properties.name, "no memory for the tracer");
    *self = (struct tracer_query){.top = top};
    enum bvhd_status status = tracer_device_init(&self->device, gpu, &kernel, memory, error);
    if (status) {
        memory_free(memory, self);
        return status;
    }
    self->device.push.has_top = 1;
    self->device.structures = &self->top;
    *ret_tracer = &self->device.tracer;
    return BVHD_OK;
}
