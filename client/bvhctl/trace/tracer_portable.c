/* SPDX-License-Identifier: Apache-2.0 */
#include <stdint.h>

#include "proto/base/status.h"
#include "client/bvhctl/trace/tracer_closest.h"
#include "client/bvhctl/trace/tracer_scene.h"

#include "client/bvhctl/kernels/trace_portable.h"
#include "client/bvhctl/kernels/trace_portable_address.h"

enum { BINDING_SCENE = 2 };

struct tracer_portable {
    struct tracer_device device; /* its first member */
    struct bvhd_vulkan_scene *scene;
    struct gpu_buffer storage; /* the scene's: not to be destroyed */
    struct tracer_closest closest;
};

static void release(struct tracer_device *device)
{
    struct tracer_portable *self = (struct tracer_portable *)device;
    bvhd_vulkan_scene_destroy(self->scene);
}

static int choose(const struct tracer_device *device, const struct ray *rays, uint64_t count)
{
    return tracer_closest_choose(&((const struct tracer_portable *)device)->closest, rays, count);
}

void tracer_portable_set_way(struct tracer *tracer, enum tracer_way way)
{
    ((struct tracer_portable *)tracer)->closest.way = way;
}

/* Vulkan lets fma() round twice. The hardware of these vendors has one that rounds once. */
static bool has_fused_fma(struct gpu *gpu)
{
    enum { AMD = 0x1002, NVIDIA = 0x10de, INTEL = 0x8086 };
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2};
    gpu_properties(gpu, &properties);
    uint32_t vendor = properties.properties.vendorID;
    return vendor == AMD || vendor == NVIDIA || vendor == INTEL;
}

static enum bvhd_status create_kernel(struct tracer_portable *self, struct gpu *gpu, struct memory *memory,
                                      struct bvhd_error *error)
{
    const uint32_t constants[] = {TRACER_GROUP, false, has_fused_fma(gpu)}; /* group, plain bytes, fused fma */
    bool by_address = gpu->properties.has_buffer_address;
    const struct gpu_kernel_options options = {
        .code = by_address ? trace_portable_address_code : trace_portable_code,
        .size = by_address ? sizeof trace_portable_address_code : sizeof trace_portable_code,
        .bindings = by_address ? BINDING_SCENE : BINDING_SCENE + 1,
        .constants = constants,
        .constant_count = sizeof constants / sizeof *constants,
    };
    enum bvhd_status status = tracer_device_init(&self->device, gpu, &options, memory, error);
    if (status)
        return status;
    self->device.release = release;
    self->device.tracer.target = TARGET_PORTABLE;
    self->device.buffers[0] = &self->storage;
    return BVHD_OK;
}

/* Where the kernel starts, and, without addresses, the buffer that it looks into. */
static enum bvhd_status find_root(struct tracer_portable *self, const struct structures *structures,
                                  struct bvhd_error *error)
{
    const struct gpu *gpu = self->device.gpu;
    uint32_t root = structures->has_top ? structures->file_count - 1 : 0;
    struct bvhd_vulkan_span span;
    VkDeviceSize size;
    enum bvhd_status status = bvhd_vulkan_scene_storage(self->scene, root, &span, &size);
    if (status)
        return bvhd_error_set(error, status, structures->name, "nothing to trace was loaded");
    if (!gpu->properties.has_buffer_address && size > gpu->properties.max_storage_range)
        return bvhd_error_set(error, BVHD_TOO_LARGE, structures->name,
                              "more bytes than this device binds (%llu), and it has no buffer addresses",
                              (unsigned long long)gpu->properties.max_storage_range);
    uint64_t location = bvhd_vulkan_scene_location(self->scene, root);
    self->storage = (struct gpu_buffer){.buffer = span.buffer, .size = size};
    self->device.push.has_top = structures->has_top;
    self->device.push.extra[0] = (uint32_t)location;
    self->device.push.extra[1] = (uint32_t)(location >> 32);
    if (gpu->properties.has_buffer_address) {
        const VkBufferDeviceAddressInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO,
                                                .buffer = span.buffer};
        uint64_t base = gpu->vk.GetBufferDeviceAddress(gpu->device, &info);
        self->device.push.scene_base[0] = (uint32_t)base;
        self->device.push.scene_base[1] = (uint32_t)(base >> 32);
    }
    return BVHD_OK;
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
    enum bvhd_status status = create_kernel(self, gpu, memory, error);
    if (status) {
        memory_free(memory, self);
        return status;
    }
    status = tracer_scene_create(gpu, structures, gpu->properties.has_buffer_address ? BVHD_VULKAN_SCENE_ADDRESSES : 0,
                                 memory, &self->scene, error);
    if (!status)
        status = find_root(self, structures, error);
    if (!status)
        status = tracer_closest_init(&self->closest, &self->device, structures, has_fused_fma(gpu), error);
    self->device.choose = choose;
    if (status)
        tracer_device_destroy(&self->device);
    else
        *ret_tracer = &self->device.tracer;
    return status;
}
