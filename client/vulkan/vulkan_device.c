/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan/vulkan_device.h"

#include <stdio.h>
#include <string.h>

#include "client/argument.h"
#include "client/library.h"

/* The functions that are needed before there is a struct bvhd_vulkan_device. */
struct lookup {
    const struct bvhd_vulkan_device_options *options;
    PFN_vkGetDeviceProcAddr get_device_proc_addr;
    PFN_vkGetPhysicalDeviceProperties2 get_properties;
    PFN_vkGetPhysicalDeviceMemoryProperties get_memory;
    PFN_vkEnumerateDeviceExtensionProperties enumerate_extensions;
    struct bvhd_error *error;
};

static enum bvhd_status missing(const struct lookup *lookup, const char *name)
{
    return bvhd_error_set(lookup->error, BVHD_INVALID, name, "the device has no such function");
}

static PFN_vkVoidFunction instance_function(const struct lookup *lookup, const char *name)
{
    return lookup->options->get_instance_proc_addr(lookup->options->instance, name);
}

static enum bvhd_status find_instance_functions(struct lookup *lookup)
{
    lookup->get_device_proc_addr = (PFN_vkGetDeviceProcAddr)instance_function(lookup, "vkGetDeviceProcAddr");
    if (!lookup->get_device_proc_addr)
        return missing(lookup, "vkGetDeviceProcAddr");
    lookup->get_properties =
        (PFN_vkGetPhysicalDeviceProperties2)instance_function(lookup, "vkGetPhysicalDeviceProperties2");
    if (!lookup->get_properties)
        return missing(lookup, "vkGetPhysicalDeviceProperties2");
    lookup->get_memory =
        (PFN_vkGetPhysicalDeviceMemoryProperties)instance_function(lookup, "vkGetPhysicalDeviceMemoryProperties");
    if (!lookup->get_memory)
        return missing(lookup, "vkGetPhysicalDeviceMemoryProperties");
    lookup->enumerate_extensions =
        (PFN_vkEnumerateDeviceExtensionProperties)instance_function(lookup, "vkEnumerateDeviceExtensionProperties");
    return lookup->enumerate_extensions ? BVHD_OK : missing(lookup, "vkEnumerateDeviceExtensionProperties");
}

/*
 * The name with the extension's suffix comes first: a device of Vulkan 1.1 has the function only under that name, and
 * the other name may return a function that does not work.
 */
static PFN_vkVoidFunction address_function(const struct lookup *lookup, const char *name)
{
    char extended[64];
    snprintf(extended, sizeof extended, "%sKHR", name);
    PFN_vkVoidFunction function = lookup->get_device_proc_addr(lookup->options->device, extended);
    return function ? function : lookup->get_device_proc_addr(lookup->options->device, name);
}

static enum bvhd_status find_device_functions(const struct lookup *lookup, struct bvhd_vulkan_device *device)
{
#define FIND(name, wanted, function)                                                                                   \
    if (wanted) {                                                                                                      \
        device->vk.name = (PFN_vk##name)(function);                                                                    \
        if (!device->vk.name)                                                                                          \
            return missing(lookup, "vk" #name);                                                                        \
    }
#define VULKAN_ALWAYS(name) FIND(name, true, lookup->get_device_proc_addr(lookup->options->device, "vk" #name))
#define VULKAN_ADDRESS(name) FIND(name, device->has_addresses, address_function(lookup, "vk" #name))
#define VULKAN_STRUCTURE(name)                                                                                         \
    FIND(name, device->has_structures, lookup->get_device_proc_addr(lookup->options->device, "vk" #name))
#include "client/vulkan/vulkan_functions.def"
#undef VULKAN_ALWAYS
#undef VULKAN_ADDRESS
#undef VULKAN_STRUCTURE
#undef FIND
    return BVHD_OK;
}

/* The property structs beyond those of Vulkan 1.1 that the physical device supports. */
struct extensions {
    bool buffer_limit, driver, multiprocessors;
};

static enum bvhd_status find_extensions(const struct lookup *lookup, struct extensions *ret_extensions)
{
    VkPhysicalDevice physical = lookup->options->physical_device;
    uint32_t count = 0;
    VkResult result = lookup->enumerate_extensions(physical, NULL, &count, NULL);
    if (result != VK_SUCCESS)
        return vulkan_device_result("vkEnumerateDeviceExtensionProperties", result, lookup->error);
    memset(ret_extensions, 0, sizeof *ret_extensions);
    if (count == 0)
        return BVHD_OK;
    VkExtensionProperties *list = memory_array(&library_memory, count, sizeof *list);
    if (!list)
        return bvhd_error_no_memory(lookup->error, "device", "no memory for a list of %u extensions", (unsigned)count);
    result = lookup->enumerate_extensions(physical, NULL, &count, list);
    if (result == VK_SUCCESS || result == VK_INCOMPLETE)
        for (uint32_t i = 0; i < count; i++) {
            ret_extensions->buffer_limit |= strcmp(list[i].extensionName, VK_KHR_MAINTENANCE_4_EXTENSION_NAME) == 0;
            ret_extensions->driver |= strcmp(list[i].extensionName, VK_KHR_DRIVER_PROPERTIES_EXTENSION_NAME) == 0;
            ret_extensions->multiprocessors |=
                strcmp(list[i].extensionName, VK_NV_SHADER_SM_BUILTINS_EXTENSION_NAME) == 0;
        }
    memory_free(&library_memory, list);
    return result < 0 ? vulkan_device_result("vkEnumerateDeviceExtensionProperties", result, lookup->error) : BVHD_OK;
}

static struct vulkan_compute compute_of(const VkPhysicalDeviceProperties *properties,
                                        const VkPhysicalDeviceSubgroupProperties *subgroup,
                                        const VkPhysicalDeviceShaderSMBuiltinsPropertiesNV *multiprocessors)
{
    const VkPhysicalDeviceLimits *limits = &properties->limits;
    uint32_t invocations = limits->maxComputeWorkGroupInvocations, size = limits->maxComputeWorkGroupSize[0];
    bool has_subgroups = subgroup->supportedStages & VK_SHADER_STAGE_COMPUTE_BIT;
    return (struct vulkan_compute){
        .api_version = properties->apiVersion,
        .vendor = properties->vendorID,
        .type = properties->deviceType,
        .max_groups = limits->maxComputeWorkGroupCount[0],
        .max_group_size = invocations < size ? invocations : size,
        .subgroup_size = subgroup->subgroupSize,
        .subgroup_operations = has_subgroups ? subgroup->supportedOperations : 0,
        .multiprocessors = multiprocessors->shaderSMCount,
        .warps = multiprocessors->shaderWarpsPerSM,
    };
}

static void read_properties(const struct lookup *lookup, struct extensions extensions,
                            struct bvhd_vulkan_device *device)
{
    VkPhysicalDeviceShaderSMBuiltinsPropertiesNV multiprocessors = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SHADER_SM_BUILTINS_PROPERTIES_NV};
    VkPhysicalDeviceSubgroupProperties subgroup = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES};
    VkPhysicalDeviceMaintenance4Properties buffer = {.sType =
                                                         VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_4_PROPERTIES};
    VkPhysicalDeviceDriverProperties driver = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES};
    VkPhysicalDeviceAccelerationStructurePropertiesKHR structure = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_PROPERTIES_KHR};
    VkPhysicalDeviceMaintenance3Properties allocation = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES, .pNext = &subgroup};
    VkPhysicalDeviceProperties2 all = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &allocation};
    void **next = &subgroup.pNext;
    if (extensions.buffer_limit) {
        *next = &buffer;
        next = &buffer.pNext;
    }
    if (extensions.driver) {
        *next = &driver;
        next = &driver.pNext;
    }
    if (extensions.multiprocessors) {
        *next = &multiprocessors;
        next = &multiprocessors.pNext;
    }
    if (device->has_structures)
        *next = &structure;
    lookup->get_properties(lookup->options->physical_device, &all);

    device->limits = (struct vulkan_limits){
        .storage_range = all.properties.limits.maxStorageBufferRange,
        .storage_alignment = all.properties.limits.minStorageBufferOffsetAlignment,
        .allocation = allocation.maxMemoryAllocationSize,
        .buffer = extensions.buffer_limit ? buffer.maxBufferSize : UINT64_MAX,
        .primitives = structure.maxPrimitiveCount,
        .instances = structure.maxInstanceCount,
        .scratch_alignment = structure.minAccelerationStructureScratchOffsetAlignment,
    };
    device->compute = compute_of(&all.properties, &subgroup, &multiprocessors);
    snprintf(device->name, sizeof device->name, "%s", all.properties.deviceName);
    snprintf(device->driver, sizeof device->driver, "%s%s%s", driver.driverName, *driver.driverInfo ? " " : "",
             driver.driverInfo);
}

static enum bvhd_status check_options(const struct bvhd_vulkan_device_options *options, struct bvhd_error *error)
{
    enum bvhd_status status =
        argument_check_size(options, sizeof *options, sizeof *options, "options", "bvhd_vulkan_device_options", error);
    if (status != BVHD_OK)
        return status;
    if (!options->get_instance_proc_addr)
        return bvhd_error_set(error, BVHD_INVALID, "options.get_instance_proc_addr",
                              "options.get_instance_proc_addr is NULL");
    return ARGUMENTS_CHECK(error, {options->instance, "options.instance"},
                           {options->physical_device, "options.physical_device"}, {options->device, "options.device"});
}

static enum bvhd_status fill_device(const struct bvhd_vulkan_device_options *options, struct bvhd_vulkan_device *device,
                                    struct bvhd_error *error)
{
    struct lookup lookup = {.options = options, .error = error};
    struct extensions extensions;
    memset(device, 0, sizeof *device);
    device->handle = options->device;
    device->allocator = options->allocator;
    device->has_addresses = options->has_buffer_device_address;
    device->has_structures = device->has_addresses && options->has_acceleration_structure;
    enum bvhd_status status = find_instance_functions(&lookup);
    if (status == BVHD_OK)
        status = find_device_functions(&lookup, device);
    if (status == BVHD_OK)
        status = find_extensions(&lookup, &extensions);
    if (status != BVHD_OK)
        return status;
    read_properties(&lookup, extensions, device);
    lookup.get_memory(options->physical_device, &device->memory);
    return BVHD_OK;
}

enum bvhd_status bvhd_vulkan_device_create(const struct bvhd_vulkan_device_options *options,
                                           struct bvhd_vulkan_device **ret_device, struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {options, "options"}, {ret_device, "ret_device"});
    if (status == BVHD_OK)
        status = check_options(options, ret_error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_vulkan_device *device = memory_alloc(&library_memory, sizeof *device);
    if (!device)
        return bvhd_error_no_memory(ret_error, "device", "no memory for %zu bytes", sizeof *device);
    status = fill_device(options, device, ret_error);
    if (status == BVHD_OK)
        *ret_device = device;
    else
        memory_free(&library_memory, device);
    return status;
}

void bvhd_vulkan_device_destroy(struct bvhd_vulkan_device *device)
{
    memory_free(&library_memory, device);
}

/* Returns the name of a result that these functions return, or NULL. */
static const char *result_name(VkResult result)
{
    static const struct {
        VkResult result;
        const char *name;
    } names[] = {
        {VK_NOT_READY, "VK_NOT_READY"},
        {VK_TIMEOUT, "VK_TIMEOUT"},
        {VK_ERROR_INITIALIZATION_FAILED, "VK_ERROR_INITIALIZATION_FAILED"},
        {VK_ERROR_MEMORY_MAP_FAILED, "VK_ERROR_MEMORY_MAP_FAILED"},
        {VK_ERROR_EXTENSION_NOT_PRESENT, "VK_ERROR_EXTENSION_NOT_PRESENT"},
        {VK_ERROR_FEATURE_NOT_PRESENT, "VK_ERROR_FEATURE_NOT_PRESENT"},
        {VK_ERROR_INCOMPATIBLE_DRIVER, "VK_ERROR_INCOMPATIBLE_DRIVER"},
        {VK_ERROR_FRAGMENTED_POOL, "VK_ERROR_FRAGMENTED_POOL"},
        {VK_ERROR_UNKNOWN, "VK_ERROR_UNKNOWN"},
        {VK_ERROR_OUT_OF_POOL_MEMORY, "VK_ERROR_OUT_OF_POOL_MEMORY"},
        {VK_ERROR_INVALID_SHADER_NV, "VK_ERROR_INVALID_SHADER_NV"},
    };
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (names[i].result == result)
            return names[i].name;
    return NULL;
}

enum bvhd_status vulkan_device_result(const char *call, VkResult result, struct bvhd_error *error)
{
    switch (result) {
    case VK_SUCCESS:
        return BVHD_OK;
    case VK_ERROR_OUT_OF_HOST_MEMORY:
        return bvhd_error_no_memory(error, call, "the host's memory is used up");
    case VK_ERROR_OUT_OF_DEVICE_MEMORY:
    case VK_ERROR_TOO_MANY_OBJECTS:
    case VK_ERROR_FRAGMENTATION:
        return bvhd_error_no_memory(error, call, "the device's memory is used up");
    case VK_ERROR_DEVICE_LOST:
        return bvhd_error_set(error, BVHD_UNAVAILABLE, call, "the device is lost");
    default:
        return result_name(result) ? bvhd_error_set(error, BVHD_INTERNAL, call, "%s", result_name(result))
                                   : bvhd_error_set(error, BVHD_INTERNAL, call, "VkResult %d", (int)result);
    }
}
