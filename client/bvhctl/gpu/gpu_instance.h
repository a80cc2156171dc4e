/* SPDX-License-Identifier: Apache-2.0 */
/* gpu_instance.h - the Vulkan loader, an instance, its devices and what they can do. The insides of gpu.h. */
#ifndef BVHCTL_GPU_INSTANCE_H
#define BVHCTL_GPU_INSTANCE_H

#include "client/bvhctl/gpu/gpu.h"

struct gpu_instance_functions {
#define GPU_INSTANCE_FUNCTION(name) PFN_vk##name name;
#include "client/bvhctl/gpu/gpu_functions.def"
#undef GPU_INSTANCE_FUNCTION
};

struct gpu_instance {
    void *loader; /* of dlopen */
    PFN_vkGetInstanceProcAddr get_instance_proc_addr;
    VkInstance handle;
    uint32_t version; /* of Vulkan, that it was created for */
    VkDebugUtilsMessengerEXT messenger; /* with $BVHD_VALIDATE */
    struct gpu_instance_functions vk;
};

/*
 * Finds the loader and creates an instance. BVHD_UNAVAILABLE: no loader, no driver, no validation layer where it was
 * asked for. End with gpu_instance_finish.
 */
enum bvhd_status gpu_instance_init(struct gpu_instance *instance, struct memory *memory, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void gpu_instance_finish(struct gpu_instance *instance);

/* What a device has beyond what struct gpu_properties tells: which of it gpu_open enables. */
struct gpu_features {
    bool has_queue; /* one family computes */
    uint32_t family; /* which one */
    uint32_t timestamp_bits;
    float timestamp_ns; /* nanoseconds of a tick */
    bool has_executable_info, has_subgroup_size_control, needs_portability_subset;
};

struct gpu_candidate {
    VkPhysicalDevice device;
    struct gpu_properties properties;
    struct gpu_features features;
};

/* The devices that can be opened, best first; the caller frees *ret_list. BVHD_UNAVAILABLE when there is none. */
enum bvhd_status gpu_instance_list(const struct gpu_instance *instance, struct memory *memory,
                                   struct gpu_candidate **ret_list, uint32_t *ret_count, struct bvhd_error *error);

/*
 * Fills properties and features of one device. False for a device that cannot be opened: older than Vulkan 1.1, or
 * without a queue that computes.
 */
bool gpu_properties_read(const struct gpu_instance *instance, VkPhysicalDevice device, struct memory *memory,
                         struct gpu_candidate *ret_candidate);

/* Puts a struct at the head of a pNext chain, when it is wanted. */
static inline void gpu_chain(void **chain, bool is_wanted, void *entry, void **entry_next)
{
    if (!is_wanted)
        return;
    *entry_next = *chain;
    *chain = entry;
}

#endif
