/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/gpu/gpu_instance.h"

/* The extensions of the device that bvhctl uses. */
struct gpu_extensions {
    bool acceleration_structure, deferred_host_operations, ray_query, ray_pipeline, executable_properties;
    bool position_fetch, subgroup_size_control, portability_subset;
};

static void note_extension(const char *name, struct gpu_extensions *found)
{
    const struct {
        const char *name;
        bool *is_there;
    } rows[] = {
        {VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME, &found->acceleration_structure},
        {VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME, &found->deferred_host_operations},
        {VK_KHR_RAY_QUERY_EXTENSION_NAME, &found->ray_query},
        {VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME, &found->ray_pipeline},
        {VK_KHR_PIPELINE_EXECUTABLE_PROPERTIES_EXTENSION_NAME, &found->executable_properties},
        {"VK_KHR_ray_tracing_position_fetch", &found->position_fetch},
        {VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME, &found->subgroup_size_control},
        {"VK_KHR_portability_subset", &found->portability_subset},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        if (!strcmp(name, rows[i].name))
            *rows[i].is_there = true;
}

static void read_extensions(const struct gpu_instance *instance, VkPhysicalDevice device, struct memory *memory,
                            struct gpu_extensions *ret_found)
{
    uint32_t count = 0;
    if (instance->vk.EnumerateDeviceExtensionProperties(device, NULL, &count, NULL) || !count)
        return;
    VkExtensionProperties *rows = memory_array(memory, count, sizeof *rows);
    if (rows && instance->vk.EnumerateDeviceExtensionProperties(device, NULL, &count, rows) >= 0)
        for (uint32_t i = 0; i < count; i++)
            note_extension(rows[i].extensionName, ret_found);
    memory_free(memory, rows);
}

/* Finds a queue family that computes. It prefers one that also draws, because drivers support everything on those. */
static void find_family(const struct gpu_instance *instance, VkPhysicalDevice device, struct memory *memory,
                        struct gpu_features *features)
{
    uint32_t count = 0;
    instance->vk.GetPhysicalDeviceQueueFamilyProperties(device, &count, NULL);
    VkQueueFamilyProperties *families = memory_array(memory, count, sizeof *families);
    if (families)
        instance->vk.GetPhysicalDeviceQueueFamilyProperties(device, &count, families);
    for (uint32_t i = 0; families && i < count; i++) {
        bool computes = families[i].queueFlags & VK_QUEUE_COMPUTE_BIT,
             draws = families[i].queueFlags & VK_QUEUE_GRAPHICS_BIT;
        if (!computes || !families[i].queueCount || (features->has_queue && !draws))
            continue;
        features->has_queue = true;
        features->family = i;
        features->timestamp_bits = families[i].timestampValidBits;
        if (draws)
            break;
    }
    memory_free(memory, families);
}

static uint64_t largest_heap(const struct gpu_instance *instance, VkPhysicalDevice device)
{
    VkPhysicalDeviceMemoryProperties memory;
    instance->vk.GetPhysicalDeviceMemoryProperties(device, &memory);
    uint64_t largest = 0;
    for (uint32_t i = 0; i < memory.memoryHeapCount; i++)
        if ((memory.memoryHeaps[i].flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) && memory.memoryHeaps[i].size > largest)
            largest = memory.memoryHeaps[i].size;
    return largest;
}

/* The struct with the driver's name exists since Vulkan 1.2. */
static void read_properties(const struct gpu_instance *instance, VkPhysicalDevice device, uint32_t version,
                            struct gpu_candidate *candidate)
{
    VkPhysicalDeviceDriverProperties driver = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES};
    VkPhysicalDeviceSubgroupProperties subgroup = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES,
        .pNext = version >= VK_API_VERSION_1_2 ? &driver : NULL,
    };
    VkPhysicalDeviceProperties2 reply = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &subgroup};
    instance->vk.GetPhysicalDeviceProperties2(device, &reply);
    struct gpu_properties *properties = &candidate->properties;
    snprintf(properties->name, sizeof properties->name, "%.*s", VK_MAX_PHYSICAL_DEVICE_NAME_SIZE - 1,
             reply.properties.deviceName);
    if (*driver.driverName)
        snprintf(properties->driver, sizeof properties->driver, "%.*s%s%.*s", VK_MAX_DRIVER_NAME_SIZE - 1,
                 driver.driverName, *driver.driverInfo ? " " : "", VK_MAX_DRIVER_INFO_SIZE - 1, driver.driverInfo);
    else
        snprintf(properties->driver, sizeof properties->driver, "version %08x",
                 (unsigned)reply.properties.driverVersion);
    properties->type = reply.properties.deviceType;
    properties->api_version = version;
    properties->max_storage_range = reply.properties.limits.maxStorageBufferRange;
    properties->max_groups = reply.properties.limits.maxComputeWorkGroupCount[0];
    properties->subgroup_size = subgroup.subgroupSize;
    properties->memory = largest_heap(instance, device);
    candidate->features.timestamp_ns = reply.properties.limits.timestampPeriod;
}

static void read_features_1_2(const struct gpu_instance *instance, VkPhysicalDevice device,
                              const struct gpu_extensions *extensions, struct gpu_candidate *candidate)
{
    VkPhysicalDeviceVulkan12Features core = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
    VkPhysicalDeviceFeatures2 features = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, .pNext = &core};
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structures = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR};
    VkPhysicalDeviceRayQueryFeaturesKHR query = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_QUERY_FEATURES_KHR};
    VkPhysicalDeviceRayTracingPipelineFeaturesKHR pipeline = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR};
    VkPhysicalDevicePipelineExecutablePropertiesFeaturesKHR executable = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PIPELINE_EXECUTABLE_PROPERTIES_FEATURES_KHR};
    VkPhysicalDeviceSubgroupSizeControlFeatures size = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES};
    bool has_structures = extensions->acceleration_structure && extensions->deferred_host_operations;
    void *chain = &core;
    gpu_chain(&chain, has_structures, &structures, &structures.pNext);
    gpu_chain(&chain, extensions->ray_query, &query, &query.pNext);
    gpu_chain(&chain, extensions->ray_pipeline, &pipeline, &pipeline.pNext);
    gpu_chain(&chain, extensions->executable_properties, &executable, &executable.pNext);
    gpu_chain(&chain, extensions->subgroup_size_control, &size, &size.pNext);
#ifdef VK_KHR_ray_tracing_position_fetch
    VkPhysicalDeviceRayTracingPositionFetchFeaturesKHR positions = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_POSITION_FETCH_FEATURES_KHR};
    gpu_chain(&chain, extensions->position_fetch, &positions, &positions.pNext);
#endif
    features.pNext = chain;
    instance->vk.GetPhysicalDeviceFeatures2(device, &features);
    struct gpu_properties *properties = &candidate->properties;
    properties->has_buffer_address = core.bufferDeviceAddress;
    properties->has_doubles = features.features.shaderFloat64;
    properties->has_acceleration_structure = properties->has_buffer_address && structures.accelerationStructure;
    properties->has_ray_query = properties->has_acceleration_structure && query.rayQuery;
    properties->has_ray_pipeline = properties->has_acceleration_structure && pipeline.rayTracingPipeline;
#ifdef VK_KHR_ray_tracing_position_fetch
    properties->has_position_fetch = properties->has_acceleration_structure && positions.rayTracingPositionFetch;
#endif
    candidate->features.has_executable_info = executable.pipelineExecutableInfo;
    candidate->features.has_subgroup_size_control = size.subgroupSizeControl;
}

bool gpu_properties_read(const struct gpu_instance *instance, VkPhysicalDevice device, struct memory *memory,
                         struct gpu_candidate *ret_candidate)
{
    VkPhysicalDeviceProperties properties;
    struct gpu_extensions extensions = {.ray_query = false};
    struct gpu_candidate candidate = {.device = device};
    instance->vk.GetPhysicalDeviceProperties(device, &properties);
    if (properties.apiVersion < VK_API_VERSION_1_1)
        return false;
    find_family(instance, device, memory, &candidate.features);
    if (!candidate.features.has_queue)
        return false;
    uint32_t version = properties.apiVersion < instance->version ? properties.apiVersion : instance->version;
    read_extensions(instance, device, memory, &extensions);
    candidate.features.needs_portability_subset = extensions.portability_subset;
    read_properties(instance, device, version, &candidate);
    if (version >= VK_API_VERSION_1_2)
        read_features_1_2(instance, device, &extensions, &candidate);
    *ret_candidate = candidate;
    return true;
}
