/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gpu.h - Vulkan devices: which there are, and one of them opened for compute. The Vulkan loader is found at run time
 * (dlopen), so bvhctl starts without it.
 *
 * Everything that Vulkan can do here goes through struct gpu's function table: `gpu->vk.CmdDispatch(...)`, looked up
 * for this device.
 */
#ifndef BVHCTL_GPU_H
#define BVHCTL_GPU_H

#include <stdbool.h>

#include "bvhd/bvhd_vulkan.h"
#include "proto/base/memory.h"
#include "client/vulkan/vulkan_work.h"

/* What is known about a device before it is opened. */
struct gpu_properties {
    char name[VK_MAX_PHYSICAL_DEVICE_NAME_SIZE];
    char driver[VK_MAX_DRIVER_NAME_SIZE + VK_MAX_DRIVER_INFO_SIZE + 2]; /* "llvmpipe Mesa 25.0.7" */
    VkPhysicalDeviceType type;
    uint32_t api_version;
    bool has_acceleration_structure, has_ray_query, has_ray_pipeline, has_buffer_address; /* with Vulkan 1.2 or newer */
    bool has_position_fetch; /* likewise; never when the Vulkan headers that this was built with do not know it */
    bool has_doubles,
        /* likewise, in shaders; quick: that a few of them do not hold up what else a shader does, as far as is known */
        has_quick_doubles;
    uint64_t memory; /* bytes of its largest device-local heap */
    uint64_t max_storage_range; /* bytes of a storage buffer that a shader can bind */
    uint32_t max_groups; /* in x, of a dispatch */
    char number[12]; /* its place in gpu_list, from 0: for gpu_open, whatever others are called */
    uint32_t subgroup_size;
    uint32_t multiprocessors; /* of NVIDIA's; 0: not told */
};

/*
 * Lists the devices that could be opened, best first: discrete, integrated, virtual, CPU; the loader's order among
 * equals. BVHD_UNAVAILABLE when there is no loader or no driver, with what is missing. The caller frees *ret_list with
 * memory_free.
 */
enum bvhd_status gpu_list(struct memory *memory, struct gpu_properties **ret_list, uint32_t *ret_count,
                          struct bvhd_error *error);

/* The functions of a device that are in use; NULL where its extension is missing. */
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
    struct bvhd_vulkan_device *library; /* libbvhd's view of it */
    struct vulkan_work work;
    double timestamp_ms; /* milliseconds of one tick; 0: the queue has no timestamps */
    uint64_t timestamp_mask; /* the bits of a tick count that are valid */
    bool has_small_halves; /* shaders keep denormal halves (gpu_keeps_small_halves), and are quick to; not a CPU's */
    struct gpu_instance *owner; /* of the instance, with the loader */
    struct memory *memory;
};

/*
 * Opens the device whose name contains `name`, letter case ignored ("auto": the first of gpu_list; a number below their
 * count: that one of them); all features that struct gpu_properties names are enabled. BVHD_NOT_FOUND lists what there
 * is. With $BVHD_VALIDATE set to 1 the Khronos validation layer is loaded, its absence an error, and its messages of
 * warnings and errors go to stderr and are counted by gpu_messages. End with gpu_close.
 */
enum bvhd_status gpu_open(const char *name, struct memory *memory, struct gpu **ret_gpu, struct bvhd_error *error);
/* NULL-safe. */
void gpu_close(struct gpu *gpu);

/* vkGetPhysicalDeviceProperties2, for what the properties do not tell; the caller has filled in the chain. */
void gpu_properties(struct gpu *gpu, VkPhysicalDeviceProperties2 *properties);

/* Messages of the validation layer so far, of all devices of the process. */
unsigned gpu_messages(void);

/* ---- Memory ---- */

struct gpu_buffer {
    VkBuffer buffer;
    VkDeviceMemory memory;
    VkDeviceSize size;
    void *mapped; /* GPU_UPLOAD and GPU_READBACK: host-visible and coherent, mapped as long as it lives */
    VkDeviceAddress address; /* 0 where the device has no addresses */
};

enum gpu_place { GPU_DEVICE, GPU_UPLOAD, GPU_READBACK };

/*
 * Of at least one byte. Usage is completed with the device address where there are addresses. BVHD_NO_MEMORY,
 * BVHD_TOO_LARGE.
 */
enum bvhd_status gpu_buffer_create(struct gpu *gpu, VkDeviceSize size, VkBufferUsageFlags usage, enum gpu_place place,
                                   struct gpu_buffer *ret_buffer, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void gpu_buffer_destroy(struct gpu *gpu, struct gpu_buffer *buffer);

/* ---- Work ---- */

/*
 * Begins the device's command buffer, one at a time; gpu_submit ends it, submits and waits: also after a failure
 * nothing of it is under way.
 */
enum bvhd_status gpu_begin(struct gpu *gpu, VkCommandBuffer *ret_commands, struct bvhd_error *error);
enum bvhd_status gpu_submit(struct gpu *gpu, VkCommandBuffer commands, struct bvhd_error *error);

/*
 * The time that the device takes for a part of a command buffer. Without timestamps (gpu->timestamp_ms is 0) start and
 * stop record nothing, and the seconds are negative.
 */
struct gpu_timer {
    VkQueryPool pool;
};

enum bvhd_status gpu_timer_create(struct gpu *gpu, struct gpu_timer *ret_timer, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void gpu_timer_destroy(struct gpu *gpu, struct gpu_timer *timer);
void gpu_timer_start(struct gpu *gpu, struct gpu_timer *timer, VkCommandBuffer commands);
void gpu_timer_stop(struct gpu *gpu, struct gpu_timer *timer, VkCommandBuffer commands);
/* After the command buffer has been submitted, by gpu_submit. */
double gpu_timer_seconds(struct gpu *gpu, const struct gpu_timer *timer);

/* "vkCreateBuffer" and its result as a status with a text; BVHD_OK for VK_SUCCESS. */
enum bvhd_status gpu_result(const char *call, VkResult result, struct bvhd_error *error);

/* A compute pipeline from SPIR-V, with specialisation constants 0 .. count - 1. */
struct gpu_kernel {
    VkDescriptorSetLayout set_layout;
    VkPipelineLayout layout;
    VkPipeline pipeline;
    VkDescriptorPool pool;
    VkDescriptorSet set; /* one, over `bindings` storage buffers, and after them `structures` acceleration structures */
    uint32_t bindings, structures, push_size;
};

struct gpu_kernel_options {
    const uint32_t *code; /* SPIR-V */
    size_t size; /* bytes */
    uint32_t bindings, structures;
    uint32_t push_size; /* bytes of push constants */
    const uint32_t *constants;
    uint32_t constant_count;
};

enum bvhd_status gpu_kernel_create(struct gpu *gpu, const struct gpu_kernel_options *options,
                                   struct gpu_kernel *ret_kernel, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void gpu_kernel_destroy(struct gpu *gpu, struct gpu_kernel *kernel);
/*
 * Points binding i at buffers[i], and the acceleration structures behind them. Of a buffer above
 * properties.max_storage_range the first so many bytes are bound; the rest has to be reached by its address. Not while
 * the kernel runs.
 */
void gpu_kernel_bind(struct gpu *gpu, struct gpu_kernel *kernel, const struct gpu_buffer *const *buffers,
                     const VkAccelerationStructureKHR *structures);

/*
 * Records its binding, its push constants (`push_size` of its options, NULL for none) and a dispatch of so many
 * workgroups in x.
 */
void gpu_kernel_record(struct gpu *gpu, const struct gpu_kernel *kernel, VkCommandBuffer commands, const void *push,
                       uint32_t groups);

/*
 * Whether shaders make floats of denormal halves, those of bytes, as they are: Vulkan lets a device take them for 0.
 * Asks the device; false, too, when it cannot be asked.
 */
bool gpu_keeps_small_halves(struct gpu *gpu);

#endif
