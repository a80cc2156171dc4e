/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/gpu/gpu_instance.h"

#include <dlfcn.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "proto/base/status.h"

static const char validation_layer[] = "VK_LAYER_KHRONOS_validation";

static atomic_uint message_count;

unsigned gpu_messages(void)
{
    return atomic_load(&message_count);
}

static VKAPI_ATTR VkBool32 VKAPI_CALL show_message(VkDebugUtilsMessageSeverityFlagBitsEXT severity,
                                                   VkDebugUtilsMessageTypeFlagsEXT types,
                                                   const VkDebugUtilsMessengerCallbackDataEXT *data, void *context)
{
    (void)severity;
    (void)types;
    (void)context;
    atomic_fetch_add(&message_count, 1);
    fprintf(stderr, "validation: %s\n", data->pMessage);
    return VK_FALSE;
}

/* Messages of the type "general" are left out: they are about the loader and its drivers, not about our calls. */
static const VkDebugUtilsMessengerCreateInfoEXT messenger_info = {
    .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT,
    .messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
    .messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT,
    .pfnUserCallback = show_message,
};

static bool wants_validation(void)
{
    const char *value = getenv("BVHD_VALIDATE");
    return value && !strcmp(value, "1");
}

static enum bvhd_status open_loader(struct gpu_instance *instance, struct bvhd_error *error)
{
    instance->loader = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
    if (!instance->loader)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "libvulkan.so.1",
                              "there is no Vulkan loader here (Debian: package libvulkan1)");
    void *symbol = dlsym(instance->loader, "vkGetInstanceProcAddr");
    if (!symbol)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "libvulkan.so.1", "has no vkGetInstanceProcAddr");
    memcpy(&instance->get_instance_proc_addr, &symbol, sizeof symbol);
    return BVHD_OK;
}

static bool has_layer(const struct gpu_instance *instance, const char *name, struct memory *memory)
{
    PFN_vkEnumerateInstanceLayerProperties enumerate =
        (PFN_vkEnumerateInstanceLayerProperties)instance->get_instance_proc_addr(NULL,
                                                                                 "vkEnumerateInstanceLayerProperties");
    uint32_t count = 0;
    bool found = false;
    if (!enumerate || enumerate(&count, NULL) || !count)
        return false;
    VkLayerProperties *layers = memory_array(memory, count, sizeof *layers);
    if (layers && enumerate(&count, layers) >= 0)
        for (uint32_t i = 0; i < count; i++)
            found |= !strcmp(layers[i].layerName, name);
    memory_free(memory, layers);
    return found;
}

/* Returns the newest version of Vulkan that both the loader and this program know, or 0 when that is below 1.1. */
static uint32_t usable_version(const struct gpu_instance *instance)
{
    PFN_vkEnumerateInstanceVersion enumerate =
        (PFN_vkEnumerateInstanceVersion)instance->get_instance_proc_addr(NULL, "vkEnumerateInstanceVersion");
    uint32_t version = 0;
    if (!enumerate || enumerate(&version) || version < VK_API_VERSION_1_1)
        return 0;
    return version < VK_API_VERSION_1_3 ? version : VK_API_VERSION_1_3;
}

/*
 * Turns on the layer's synchronisation checks for accesses by shaders, which are off by default. Layers that are as old
 * as headers without this extension do not have them.
 */
#ifdef VK_EXT_layer_settings
static const VkBool32 switched_on = VK_TRUE;
static const VkLayerSettingEXT settings[] = {
    {validation_layer, "syncval_shader_accesses_heuristic", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &switched_on}};
static const VkLayerSettingsCreateInfoEXT layer_settings = {.sType = VK_STRUCTURE_TYPE_LAYER_SETTINGS_CREATE_INFO_EXT,
                                                            .pNext = &messenger_info,
                                                            .settingCount = 1,
                                                            .pSettings = settings};
static const void *const validation_chain = &layer_settings;
#else
static const void *const validation_chain = &messenger_info;
#endif

static const char *const validation_extensions[] = {
#ifdef VK_EXT_layer_settings
    VK_EXT_LAYER_SETTINGS_EXTENSION_NAME,
#endif
    VK_EXT_DEBUG_UTILS_EXTENSION_NAME, VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME};

static enum bvhd_status create_handle(struct gpu_instance *instance, bool is_validating, struct bvhd_error *error)
{
    static const char *const layers[] = {validation_layer};
    static const VkValidationFeatureEnableEXT enables[] = {VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT};
    const VkValidationFeaturesEXT validation = {
        .sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT,
        .pNext = validation_chain,
        .enabledValidationFeatureCount = 1,
        .pEnabledValidationFeatures = enables,
    };
    const VkApplicationInfo application = {
        .sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
        .pApplicationName = "bvhctl",
        .apiVersion = instance->version,
    };
    const VkInstanceCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
        .pNext = is_validating ? &validation : NULL,
        .pApplicationInfo = &application,
        .enabledLayerCount = is_validating ? 1 : 0,
        .ppEnabledLayerNames = layers,
        .enabledExtensionCount = is_validating ? sizeof validation_extensions / sizeof *validation_extensions : 0,
        .ppEnabledExtensionNames = validation_extensions,
    };
    PFN_vkCreateInstance create = (PFN_vkCreateInstance)instance->get_instance_proc_addr(NULL, "vkCreateInstance");
    VkResult result = create ? create(&info, NULL, &instance->handle) : VK_ERROR_INITIALIZATION_FAILED;
    if (result == VK_ERROR_INCOMPATIBLE_DRIVER)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "vkCreateInstance",
                              "no Vulkan driver works here (Debian: package mesa-vulkan-drivers)");
    return gpu_result("vkCreateInstance", result, error);
}

static void look_up(struct gpu_instance *instance)
{
#define GPU_INSTANCE_FUNCTION(name)                                                                                    \
    instance->vk.name = (PFN_vk##name)instance->get_instance_proc_addr(instance->handle, "vk" #name);
#include "client/bvhctl/gpu/gpu_functions.def"
#undef GPU_INSTANCE_FUNCTION
}

static enum bvhd_status listen(struct gpu_instance *instance, struct bvhd_error *error)
{
    if (!instance->vk.CreateDebugUtilsMessengerEXT)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, validation_layer, "has no debug messenger");
    VkResult result =
        instance->vk.CreateDebugUtilsMessengerEXT(instance->handle, &messenger_info, NULL, &instance->messenger);
    return gpu_result("vkCreateDebugUtilsMessengerEXT", result, error);
}

enum bvhd_status gpu_instance_init(struct gpu_instance *ret_instance, struct memory *memory, struct bvhd_error *error)
{
    struct gpu_instance instance = {.loader = NULL};
    bool is_validating = wants_validation();
    enum bvhd_status status = open_loader(&instance, error);
    instance.version = status != BVHD_OK ? 0 : usable_version(&instance);
    if (status == BVHD_OK && !instance.version)
        status =
            bvhd_error_set(error, BVHD_UNAVAILABLE, "libvulkan.so.1", "the Vulkan loader is older than Vulkan 1.1");
    if (status == BVHD_OK && is_validating && !has_layer(&instance, validation_layer, memory))
        status = bvhd_error_set(
            error, BVHD_UNAVAILABLE, validation_layer,
            "$BVHD_VALIDATE is set, and this layer is not installed (Debian: package vulkan-validationlayers)");
    if (status == BVHD_OK)
        status = create_handle(&instance, is_validating, error);
    if (status == BVHD_OK) {
        look_up(&instance);
        status = is_validating ? listen(&instance, error) : BVHD_OK;
    }
    if (status != BVHD_OK)
        gpu_instance_finish(&instance);
    else
        *ret_instance = instance;
    return status;
}

void gpu_instance_finish(struct gpu_instance *instance)
{
    if (!instance)
        return;
    if (instance->messenger)
        instance->vk.DestroyDebugUtilsMessengerEXT(instance->handle, instance->messenger, NULL);
    if (instance->handle)
        instance->vk.DestroyInstance(instance->handle, NULL);
    if (instance->loader)
        dlclose(instance->loader);
    *instance = (struct gpu_instance){.loader = NULL};
}

static int rank(const struct gpu_candidate *candidate)
{
    switch (candidate->properties.type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
        return 0;
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
        return 1;
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
        return 2;
    case VK_PHYSICAL_DEVICE_TYPE_CPU:
        return 3;
    default:
        return 4;
    }
}

/* An insertion sort, which keeps the loader's order among equals; there are few devices. */
static void sort(struct gpu_candidate *list, uint32_t count)
{
    for (uint32_t i = 1; i < count; i++)
        for (uint32_t k = i; k > 0 && rank(&list[k]) < rank(&list[k - 1]); k--) {
            struct gpu_candidate other = list[k];
            list[k] = list[k - 1];
            list[k - 1] = other;
        }
}

static enum bvhd_status read_devices(const struct gpu_instance *instance, const VkPhysicalDevice *devices,
                                     uint32_t count, struct memory *memory, struct gpu_candidate **ret_list,
                                     uint32_t *ret_count, struct bvhd_error *error)
{
    struct gpu_candidate *list = memory_array(memory, count, sizeof *list);
    uint32_t used = 0;
    if (!list)
        return bvhd_error_no_memory(error, "devices", "no memory for the list of devices");
    for (uint32_t i = 0; i < count; i++)
        used += gpu_properties_read(instance, devices[i], memory, &list[used]);
    if (!used) {
        memory_free(memory, list);
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "devices",
                              "no Vulkan device here supports Vulkan 1.1 and compute");
    }
    sort(list, used);
    for (uint32_t i = 0; i < used; i++)
        snprintf(list[i].properties.number, sizeof list[i].properties.number, "%u", i);
    *ret_list = list;
    *ret_count = used;
    return BVHD_OK;
}

enum bvhd_status gpu_instance_list(const struct gpu_instance *instance, struct memory *memory,
                                   struct gpu_candidate **ret_list, uint32_t *ret_count, struct bvhd_error *error)
{
    uint32_t count = 0;
    VkResult result = instance->vk.EnumeratePhysicalDevices(instance->handle, &count, NULL);
    if (result)
        return gpu_result("vkEnumeratePhysicalDevices", result, error);
    if (!count)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "devices",
                              "no Vulkan driver has a device here (Debian: package mesa-vulkan-drivers)");
    VkPhysicalDevice *devices = memory_array(memory, count, sizeof(VkPhysicalDevice));
    if (!devices)
        return bvhd_error_no_memory(error, "devices", "no memory for the list of devices");
    result = instance->vk.EnumeratePhysicalDevices(instance->handle, &count, devices);
    enum bvhd_status status = result < 0 ? gpu_result("vkEnumeratePhysicalDevices", result, error) : BVHD_OK;
    if (status == BVHD_OK)
        status = read_devices(instance, devices, count, memory, ret_list, ret_count, error);
    memory_free(memory, devices);
    return status;
}

enum bvhd_status gpu_list(struct memory *memory, struct gpu_properties **ret_list, uint32_t *ret_count,
                          struct bvhd_error *error)
{
    struct gpu_instance instance = {.loader = NULL};
    struct gpu_candidate *found = NULL;
    struct gpu_properties *list = NULL;
    uint32_t count = 0;
    enum bvhd_status status = gpu_instance_init(&instance, memory, error);
    if (status == BVHD_OK)
        status = gpu_instance_list(&instance, memory, &found, &count, error);
    if (status == BVHD_OK && !(list = memory_array(memory, count, sizeof *list)))
        status = bvhd_error_no_memory(error, "devices", "no memory for the list of devices");
    if (status == BVHD_OK) {
        for (uint32_t i = 0; i < count; i++)
            list[i] = found[i].properties;
        *ret_list = list;
        *ret_count = count;
    }
    memory_free(memory, found);
    gpu_instance_finish(&instance);
    return status;
}
