/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gpu.h - lists the Vulkan devices and opens one of them for compute. The Vulkan loader is found at run time (dlopen),
 * so that bvhctl starts without it.
 *
 * Vulkan is called through the function table of struct gpu, `gpu->vk.CmdDispatch(...)`, which is looked up for its
 * device. All functions but gpu_list, gpu_open and gpu_messages are called by one thread at a time for each device.
 */
#ifndef BVHCTL_GPU_H
#define BVHCTL_GPU_H

#include <stdbool.h>

#include "bvhd/bvhd_vulkan.h"
#include "proto/base/memory.h"
#include "client/vulkan/vulkan_kernel.h"
#include "client/vulkan/vulkan_work.h"

/* The properties of a device, which are known before it is opened. */
struct gpu_properties {
    char name[VK_MAX_PHYSICAL_DEVICE_NAME_SIZE];
    char driver[VK_MAX_DRIVER_NAME_SIZE + VK_MAX_DRIVER_INFO_SIZE + 2]; /* "llvmpipe Mesa 25.0.7" */
    VkPhysicalDeviceType type;
    uint32_t api_version;
    bool has_acceleration_structure, has_ray_query, has_ray_pipeline, has_buffer_address; /* with Vulkan 1.2 or newer */
    bool has_position_fetch; /* false, too, when the Vulkan headers that bvhctl was built with do not have it */
    bool has_doubles; /* in shaders */
    uint64_t memory; /* bytes of its largest device-local heap */
    uint64_t max_storage_range; /* most bytes of a storage buffer that a shader can bind */
    uint32_t max_groups; /* most workgroups of a dispatch, in x */
    char number[12]; /* its place in gpu_list, from "0": a name for gpu_open that no other device has */
    uint32_t subgroup_size;
};

/*
 * Lists the devices that can be opened, the best first: discrete, integrated, virtual, CPU, and among equals in the
 * loader's order. BVHD_UNAVAILABLE when there is no loader or no driver; the text says what is missing. The caller
 * frees *ret_list with memory_free.
 */
enum bvhd_status gpu_list(struct memory *memory, struct gpu_properties **ret_list, uint32_t *ret_count,
                          struct bvhd_error *error);

/* The functions of a device that bvhctl calls. A function is NULL when its extension is missing. */
struct gpu_functions {
#define GPU_FUNCTION(name) PFN_vk##name name;
#include "client/bvhctl/gpu/gpu_functions.def"
#undef GPU_FUNCTION
};

struct gpu_instance;

struct gpu {
    struct gpu_properties properties;
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    struct bvhd_vulkan_queue queue; /* compute and transfer */
    PFN_vkGetInstanceProcAddr get_instance_proc_addr;
    struct gpu_functions vk;
    struct bvhd_vulkan_device *library; /* the device as libbvhd has it */
    struct vulkan_work work;
    double timestamp_ms; /* milliseconds of one tick; 0: the queue has no timestamps */
    uint64_t timestamp_mask; /* the bits of a tick count that are valid */
    struct gpu_instance *owner; /* it owns `instance` and the loader */
    struct memory *memory;
};

/*
 * Opens a device. `name` is a part of its name in any letter case, its number in gpu_list, or "auto" for the first of
 * gpu_list. All features that struct gpu_properties names are enabled. BVHD_NOT_FOUND: no device has that name; the
 * text lists those that there are. End with gpu_close.
 *
 * With $BVHD_VALIDATE set to 1, the Khronos validation layer is loaded, and it is an error if that is missing. Its
 * warnings and errors go to stderr and are counted by gpu_messages.
 */
enum bvhd_status gpu_open(const char *name, struct memory *memory, struct gpu **ret_gpu, struct bvhd_error *error);
/* NULL-safe. */
void gpu_close(struct gpu *gpu);

/* Calls vkGetPhysicalDeviceProperties2. The caller has filled in the pNext chain. */
void gpu_properties(struct gpu *gpu, VkPhysicalDeviceProperties2 *properties);

/* Returns the number of messages of the validation layer so far, about all devices of the process. */
unsigned gpu_messages(void);

/* ---- Memory ---- */

struct gpu_buffer {
    VkBuffer buffer;
    VkDeviceMemory memory;
    VkDeviceSize size;
    void *mapped; /* of GPU_UPLOAD and GPU_READBACK, which are host-visible and coherent: mapped while it lives */
    VkDeviceAddress address; /* 0 when the device has no buffer addresses */
};

enum gpu_place { GPU_DEVICE, GPU_UPLOAD, GPU_READBACK };

/*
 * Creates a buffer with memory of its own. `size` is at least 1. Where the device has buffer addresses, the usage for
 * them is added. BVHD_NO_MEMORY, BVHD_TOO_LARGE.
 */
enum bvhd_status gpu_buffer_create(struct gpu *gpu, VkDeviceSize size, VkBufferUsageFlags usage, enum gpu_place place,
                                   struct gpu_buffer *ret_buffer, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void gpu_buffer_destroy(struct gpu *gpu, struct gpu_buffer *buffer);

/* ---- Work ---- */

/*
 * Begins the device's command buffer, of which there is one. gpu_submit ends it, submits it and waits for it; even
 * after a failure the device does not execute it any more.
 */
enum bvhd_status gpu_begin(struct gpu *gpu, VkCommandBuffer *ret_commands, struct bvhd_error *error);
enum bvhd_status gpu_submit(struct gpu *gpu, VkCommandBuffer commands, struct bvhd_error *error);

/*
 * Measures the time that the device takes for the commands between start and stop. On a device without timestamps
 * (gpu->timestamp_ms is 0), start and stop record nothing, and the seconds are negative.
 */
struct gpu_timer {
    VkQueryPool pool;
};

enum bvhd_status gpu_timer_create(struct gpu *gpu, struct gpu_timer *ret_timer, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void gpu_timer_destroy(struct gpu *gpu, struct gpu_timer *timer);
void gpu_timer_start(struct gpu *gpu, struct gpu_timer *timer, VkCommandBuffer commands);
void gpu_timer_stop(struct gpu *gpu, struct gpu_timer *timer, VkCommandBuffer commands);
/* To be called after gpu_submit has returned. */
double gpu_timer_seconds(struct gpu *gpu, const struct gpu_timer *timer);

/*
 * Converts the result of a Vulkan function, whose name is `call` ("vkCreateBuffer"), to a status with a text. BVHD_OK
 * for VK_SUCCESS.
 */
enum bvhd_status gpu_result(const char *call, VkResult result, struct bvhd_error *error);

/* A compute pipeline, with one descriptor set and a pool for it. */
struct gpu_kernel {
    struct vulkan_layout layout; /* `bindings` storage buffers, and after them `structures` acceleration structures */
    VkPipeline pipeline;
    struct vulkan_set set;
};

struct gpu_kernel_options {
    const uint32_t *code; /* SPIR-V */
    size_t size; /* bytes */
    uint32_t bindings, structures;
    uint32_t push_size; /* bytes of push constants */
    const uint32_t *constants; /* the specialisation constants 0 .. constant_count - 1 */
    uint32_t constant_count;
};

enum bvhd_status gpu_kernel_create(struct gpu *gpu, const struct gpu_kernel_options *options,
                                   struct gpu_kernel *ret_kernel, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void gpu_kernel_destroy(struct gpu *gpu, struct gpu_kernel *kernel);
/*
 * Binds buffers[i] to binding i, and the acceleration structures to the bindings after them. Of a buffer larger than a
 * shader can bind only the beginning is bound; shaders must reach the rest by its address. The kernel must not be
 * running.
 */
void gpu_kernel_bind(struct gpu *gpu, struct gpu_kernel *kernel, const struct gpu_buffer *const *buffers,
                     const VkAccelerationStructureKHR *structures);

/*
 * Records the binding of the pipeline and its descriptor set, its push constants (`push` has as many bytes as the
 * options said, and is NULL for none) and a dispatch of `groups` workgroups in x.
 */
void gpu_kernel_record(struct gpu *gpu, const struct gpu_kernel *kernel, VkCommandBuffer commands, const void *push,
                       uint32_t groups);

#endif
