/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/gpu/gpu.h"

#include <stdio.h>
#include <string.h>

#include "client/bvhctl/gpu/gpu_instance.h"
#include "proto/base/status.h"

/* Results of opening devices and creating kernels that libbvhd does not convert. */
static const struct {
    VkResult result;
    enum bvhd_status status;
    const char *text;
} result_rows[] = {
    {VK_ERROR_OUT_OF_POOL_MEMORY, BVHD_NO_MEMORY, "no memory in the pool"},
    {VK_ERROR_INITIALIZATION_FAILED, BVHD_UNAVAILABLE, "the driver could not be started"},
    {VK_ERROR_INCOMPATIBLE_DRIVER, BVHD_UNAVAILABLE, "no driver works"},
    {VK_ERROR_LAYER_NOT_PRESENT, BVHD_UNAVAILABLE, "a layer is missing"},
    {VK_ERROR_EXTENSION_NOT_PRESENT, BVHD_UNSUPPORTED, "an extension is missing"},
    {VK_ERROR_FEATURE_NOT_PRESENT, BVHD_UNSUPPORTED, "a feature is missing"},
};

enum bvhd_status gpu_result(const char *call, VkResult result, struct bvhd_error *error)
{
    for (size_t i = 0; i < sizeof result_rows / sizeof *result_rows; i++)
        if (result_rows[i].result == result)
            return bvhd_error_set(error, result_rows[i].status, call, "%s", result_rows[i].text);
    return vulkan_device_result(call, result, error);
}

/* The text of the error lists the names of the devices, as many as fit. */
static enum bvhd_status no_such_device(const char *name, const struct gpu_candidate *list, uint32_t count,
                                       struct bvhd_error *error)
{
    char names[BVHD_TEXT_SIZE] = "";
    size_t used = 0;
    for (uint32_t i = 0; i < count && used < sizeof names; i++)
        used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", i ? "; " : "", list[i].properties.name);
    return bvhd_error_set(error, BVHD_NOT_FOUND, name, "no device has that name; the devices are: %s", names);
}

/* A number or a full name takes precedence over a part of a name. */
static enum bvhd_status choose(const char *name, const struct gpu_candidate *list, uint32_t count,
                               const struct gpu_candidate **ret_chosen, struct bvhd_error *error)
{
    const struct gpu_candidate *chosen = NULL;
    for (uint32_t i = count; i-- > 0;)
        if (!strcmp(name, "auto") || strcasestr(list[i].properties.name, name))
            chosen = &list[i];
    for (uint32_t i = count; i-- > 0;)
        if (!strcmp(name, list[i].properties.name))
            chosen = &list[i];
    for (uint32_t i = 0; i < count; i++)
        if (!strcmp(name, list[i].properties.number))
            chosen = &list[i];
    if (!chosen)
        return no_such_device(name, list, count, error);
    *ret_chosen = chosen;
    return BVHD_OK;
}

enum { MAX_EXTENSIONS = 8 };

/* Writes the names of the extensions that the device's properties need to names[0 .. *ret_count). */
static void name_extensions(const struct gpu_candidate *candidate, const char *names[MAX_EXTENSIONS],
                            uint32_t *ret_count)
{
    const struct gpu_properties *properties = &candidate->properties;
    const struct gpu_features *features = &candidate->features;
    const struct {
        bool is_wanted;
        const char *name;
    } rows[MAX_EXTENSIONS] = {
        {properties->has_acceleration_structure, VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME},
        {properties->has_acceleration_structure, VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME},
        {properties->has_ray_query, VK_KHR_RAY_QUERY_EXTENSION_NAME},
        {properties->has_ray_pipeline, VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME},
        {properties->has_position_fetch, "VK_KHR_ray_tracing_position_fetch"},
        {features->has_executable_info, VK_KHR_PIPELINE_EXECUTABLE_PROPERTIES_EXTENSION_NAME},
        {features->has_subgroup_size_control, VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME},
        {features->needs_portability_subset, "VK_KHR_portability_subset"},
    };
    uint32_t count = 0;
    for (int i = 0; i < MAX_EXTENSIONS; i++)
        if (rows[i].is_wanted)
            names[count++] = rows[i].name;
    *ret_count = count;
}

static VkResult create_device(const struct gpu_instance *instance, const struct gpu_candidate *candidate,
                              VkDeviceCreateInfo *info, VkDevice *ret_device)
{
    const struct gpu_properties *properties = &candidate->properties;
    const struct gpu_features *features = &candidate->features;
    VkPhysicalDeviceVulkan12Features core = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
        .bufferDeviceAddress = properties->has_buffer_address,
    };
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structures = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR,
        .accelerationStructure = VK_TRUE};
    VkPhysicalDeviceRayQueryFeaturesKHR query = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_QUERY_FEATURES_KHR,
                                                 .rayQuery = VK_TRUE};
    VkPhysicalDeviceRayTracingPipelineFeaturesKHR pipeline = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR, .rayTracingPipeline = VK_TRUE};
    VkPhysicalDevicePipelineExecutablePropertiesFeaturesKHR executable = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PIPELINE_EXECUTABLE_PROPERTIES_FEATURES_KHR,
        .pipelineExecutableInfo = VK_TRUE};
    VkPhysicalDeviceSubgroupSizeControlFeatures size = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES, .subgroupSizeControl = VK_TRUE};
    void *chain = NULL;
    if (properties->api_version >= VK_API_VERSION_1_2)
        chain = &core;
    gpu_chain(&chain, properties->has_acceleration_structure, &structures, &structures.pNext);
    gpu_chain(&chain, properties->has_ray_query, &query, &query.pNext);
    gpu_chain(&chain, properties->has_ray_pipeline, &pipeline, &pipeline.pNext);
    gpu_chain(&chain, features->has_executable_info, &executable, &executable.pNext);
    gpu_chain(&chain, features->has_subgroup_size_control, &size, &size.pNext);
#ifdef VK_KHR_ray_tracing_position_fetch
    VkPhysicalDeviceRayTracingPositionFetchFeaturesKHR positions = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_POSITION_FETCH_FEATURES_KHR,
        .rayTracingPositionFetch = VK_TRUE};
    gpu_chain(&chain, properties->has_position_fetch, &positions, &positions.pNext);
#endif
    const VkPhysicalDeviceFeatures2 enabled = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2,
                                               .pNext = chain,
                                               .features.shaderFloat64 = properties->has_doubles};
    info->pNext = &enabled;
    return instance->vk.CreateDevice(candidate->device, info, NULL, ret_device);
}

static enum bvhd_status open_device(struct gpu *gpu, const struct gpu_candidate *candidate, struct bvhd_error *error)
{
    const struct gpu_instance *instance = gpu->owner;
    const char *names[MAX_EXTENSIONS];
    const float priority = 1;
    const VkDeviceQueueCreateInfo queue = {
        .sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
        .queueFamilyIndex = candidate->features.family,
        .queueCount = 1,
        .pQueuePriorities = &priority,
    };
    VkDeviceCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
        .queueCreateInfoCount = 1,
        .pQueueCreateInfos = &queue,
        .ppEnabledExtensionNames = names,
    };
    name_extensions(candidate, names, &info.enabledExtensionCount);
    VkResult result = create_device(instance, candidate, &info, &gpu->device);
    if (result)
        return gpu_result("vkCreateDevice", result, error);
#define GPU_FUNCTION(name) gpu->vk.name = (PFN_vk##name)instance->vk.GetDeviceProcAddr(gpu->device, "vk" #name);
#include "client/bvhctl/gpu/gpu_functions.def"
#undef GPU_FUNCTION
    gpu->properties = candidate->properties;
    gpu->physical = candidate->device;
    gpu->queue.family = candidate->features.family;
    gpu->vk.GetDeviceQueue(gpu->device, gpu->queue.family, 0, &gpu->queue.queue);
    if (candidate->features.timestamp_bits) {
        gpu->timestamp_ms = candidate->features.timestamp_ns * 1e-6;
        gpu->timestamp_mask = UINT64_MAX >> (64 - candidate->features.timestamp_bits);
    }
    return BVHD_OK;
}

static enum bvhd_status open_library(struct gpu *gpu, struct bvhd_error *error)
{
    const struct bvhd_vulkan_device_options options = {
        .struct_size = sizeof options,
        .get_instance_proc_addr = gpu->get_instance_proc_addr,
        .instance = gpu->instance,
        .physical_device = gpu->physical,
        .device = gpu->device,
        .has_acceleration_structure = gpu->properties.has_acceleration_structure,
        .has_buffer_device_address = gpu->properties.has_buffer_address,
    };
    return bvhd_vulkan_device_create(&options, &gpu->library, error);
}

static enum bvhd_status open_by_name(struct gpu *gpu, const char *name, struct bvhd_error *error)
{
    struct gpu_candidate *list = NULL;
    const struct gpu_candidate *chosen = NULL;
    uint32_t count = 0;
    enum bvhd_status status = gpu_instance_init(gpu->owner, gpu->memory, error);
    if (status != BVHD_OK)
        return status;
    gpu->instance = gpu->owner->handle;
    gpu->get_instance_proc_addr = gpu->owner->get_instance_proc_addr;
    status = gpu_instance_list(gpu->owner, gpu->memory, &list, &count, error);
    if (status == BVHD_OK)
        status = choose(name, list, count, &chosen, error);
    if (status == BVHD_OK)
        status = open_device(gpu, chosen, error);
    if (status == BVHD_OK)
        status = open_library(gpu, error);
    if (status == BVHD_OK)
        status = vulkan_work_init(&gpu->work, gpu->library, &gpu->queue, error);
    memory_free(gpu->memory, list);
    return status;
}

enum bvhd_status gpu_open(const char *name, struct memory *memory, struct gpu **ret_gpu, struct bvhd_error *error)
{
    struct gpu *gpu = memory_alloc(memory, sizeof *gpu);
    struct gpu_instance *owner = memory_alloc(memory, sizeof *owner);
    if (!gpu || !owner) {
        memory_free(memory, owner);
        memory_free(memory, gpu);
        return bvhd_error_no_memory(error, name, "no memory for the device");
    }
    *owner = (struct gpu_instance){.loader = NULL};
    *gpu = (struct gpu){.owner = owner, .memory = memory};
    enum bvhd_status status = open_by_name(gpu, name, error);
    if (status != BVHD_OK) {
        gpu_close(gpu);
        return status;
    }
    *ret_gpu = gpu;
    return BVHD_OK;
}

void gpu_close(struct gpu *gpu)
{
    if (!gpu)
        return;
    struct memory *memory = gpu->memory;
    vulkan_work_finish(&gpu->work);
    bvhd_vulkan_device_destroy(gpu->library);
    if (gpu->device)
        gpu->vk.DestroyDevice(gpu->device, NULL);
    gpu_instance_finish(gpu->owner);
    memory_free(memory, gpu->owner);
    memory_free(memory, gpu);
}

void gpu_properties(struct gpu *gpu, VkPhysicalDeviceProperties2 *properties)
{
    gpu->owner->vk.GetPhysicalDeviceProperties2(gpu->physical, properties);
}
