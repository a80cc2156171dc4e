/* SPDX-License-Identifier: Apache-2.0 */
/* gpu_instance.h - the internals of gpu.h: the Vulkan loader, an instance, its devices and their properties. */
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
    uint32_t version; /* the version of Vulkan that it was created for */
    VkDebugUtilsMessengerEXT messenger; /* with $BVHD_VALIDATE */
    struct gpu_instance_functions vk;
};

/*
 * Finds the loader and creates an instance. BVHD_UNAVAILABLE: there is no loader, no driver, or not the validation
 * layer that $BVHD_VALIDATE asks for. End with gpu_instance_finish.
 */
enum bvhd_status gpu_instance_init(struct gpu_instance *instance, struct memory *memory, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void gpu_instance_finish(struct gpu_instance *instance);

/* The features of a device that gpu_open needs besides struct gpu_properties. */
struct gpu_features {
    bool has_queue; /* a queue family can compute */
    uint32_t family; /* its index */
    uint32_t timestamp_bits;
    float timestamp_ns; /* nanoseconds of a tick */
    bool has_executable_info, has_subgroup_size_control, needs_portability_subset;
};

struct gpu_candidate {
    VkPhysicalDevice device;
    struct gpu_properties properties;
    struct gpu_features features;
};

/*
 * Lists the devices that can be opened, the best first. The caller frees *ret_list with memory_free. BVHD_UNAVAILABLE
 * when there is none.
 */
enum bvhd_status gpu_instance_list(const struct gpu_instance *instance, struct memory *memory,
                                   struct gpu_candidate **ret_list, uint32_t *ret_count, struct bvhd_error *error);

/*
 * Fills in the properties and features of one device. Returns false for a device that cannot be opened because it is
 * older than Vulkan 1.1 or has no queue that can compute.
 */
bool gpu_properties_read(const struct gpu_instance *instance, VkPhysicalDevice device, struct memory *memory,
                         struct gpu_candidate *ret_candidate);

/* Puts a struct at the head of a pNext chain if `is_wanted`. */
static inline void gpu_chain(void **chain, bool is_wanted, void *entry, void **entry_next)
{
    if (!is_wanted)
        return;
    *entry_next = *chain;
    *chain = entry;
}

#endif
