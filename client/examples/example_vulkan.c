/* SPDX-License-Identifier: Apache-2.0 */
#include "example_vulkan.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RAYS = 64 * 64, GROUP = 64, NO_SUCH_DEVICE = 77 };

void example_check(const char *what, VkResult result)
{
    if (result == VK_SUCCESS)
        return;
    fprintf(stderr, "%s: VkResult %d\n", what, (int)result);
    exit(1);
}

/* ---- The device ---- */

static const char *const ray_extensions[] = {VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME,
                                             VK_KHR_RAY_QUERY_EXTENSION_NAME,
                                             VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME};
enum { RAY_EXTENSIONS = sizeof ray_extensions / sizeof ray_extensions[0] };

static int has_ray_extensions(VkPhysicalDevice physical)
{
    uint32_t count = 0, found = 0, i, k;
    VkExtensionProperties *list;
    vkEnumerateDeviceExtensionProperties(physical, NULL, &count, NULL);
    list = calloc(count + 1, sizeof *list);
    vkEnumerateDeviceExtensionProperties(physical, NULL, &count, list);
    for (i = 0; i < count; i++)
        for (k = 0; k < RAY_EXTENSIONS; k++)
            found += strcmp(list[i].extensionName, ray_extensions[k]) == 0;
    free(list);
    return found == RAY_EXTENSIONS;
}

static int has_addresses(VkPhysicalDevice physical)
{
    VkPhysicalDeviceVulkan12Features core = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
    VkPhysicalDeviceFeatures2 features = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, .pNext = &core};
    vkGetPhysicalDeviceFeatures2(physical, &features);
    return (int)core.bufferDeviceAddress;
}

static int is_fit(VkPhysicalDevice physical, enum example_device wanted)
{
    VkPhysicalDeviceProperties properties;
    vkGetPhysicalDeviceProperties(physical, &properties);
    return properties.apiVersion >= VK_API_VERSION_1_2 && (wanted == EXAMPLE_COMPUTE || has_addresses(physical)) &&
           (wanted != EXAMPLE_RAY_QUERIES || has_ray_extensions(physical));
}

static VkPhysicalDevice choose(VkInstance instance, enum example_device wanted)
{
    VkPhysicalDevice list[16];
    uint32_t count = sizeof list / sizeof list[0], i;
    vkEnumeratePhysicalDevices(instance, &count, list);
    for (i = 0; i < count; i++)
        if (is_fit(list[i], wanted))
            return list[i];
    fprintf(stderr, "no Vulkan device here can do this\n");
    exit(NO_SUCH_DEVICE);
}

static uint32_t compute_family(VkPhysicalDevice physical)
{
    VkQueueFamilyProperties families[16];
    uint32_t count = sizeof families / sizeof families[0], i;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families);
    for (i = 0; i < count; i++)
        if (families[i].queueFlags & VK_QUEUE_COMPUTE_BIT)
            return i;
    return 0;
}

static void create_device(struct example_vulkan *vulkan, enum example_device wanted)
{
    const float priority = 1;
    VkPhysicalDeviceRayQueryFeaturesKHR query = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_QUERY_FEATURES_KHR,
                                                 .rayQuery = VK_TRUE};
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structure = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR,
        .pNext = &query,
        .accelerationStructure = VK_TRUE};
    VkPhysicalDeviceVulkan12Features core = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
                                             .pNext = wanted == EXAMPLE_RAY_QUERIES ? &structure : NULL,
                                             .bufferDeviceAddress = wanted != EXAMPLE_COMPUTE};
    const VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                           .queueFamilyIndex = vulkan->family,
                                           .queueCount = 1,
                                           .pQueuePriorities = &priority};
    VkPhysicalDeviceFeatures available, enabled = {.shaderFloat64 = VK_FALSE};
    const VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                     .pNext = &core,
                                     .pEnabledFeatures = &enabled,
                                     .queueCreateInfoCount = 1,
                                     .pQueueCreateInfos = &queue,
                                     .enabledExtensionCount = wanted == EXAMPLE_RAY_QUERIES ? RAY_EXTENSIONS : 0,
                                     .ppEnabledExtensionNames = ray_extensions};
    vkGetPhysicalDeviceFeatures(vulkan->physical, &available);
    vulkan->has_float64 = enabled.shaderFloat64 = available.shaderFloat64;
    example_check("vkCreateDevice", vkCreateDevice(vulkan->physical, &info, NULL, &vulkan->device));
    vkGetDeviceQueue(vulkan->device, vulkan->family, 0, &vulkan->queue);
}

void example_open(struct example_vulkan *vulkan, enum example_device wanted)
{
    const VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
                                           .apiVersion = VK_API_VERSION_1_2};
    const VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                       .pApplicationInfo = &application};
    VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
    VkResult result = vkCreateInstance(&info, NULL, &vulkan->instance);
    if (result == VK_ERROR_INCOMPATIBLE_DRIVER) {
        fprintf(stderr, "there is no Vulkan driver\n");
        exit(NO_SUCH_DEVICE);
    }
    example_check("vkCreateInstance", result);
    vulkan->physical = choose(vulkan->instance, wanted);
    vulkan->family = pool.queueFamilyIndex = compute_family(vulkan->physical);
    create_device(vulkan, wanted);
    example_check("vkCreateCommandPool", vkCreateCommandPool(vulkan->device, &pool, NULL, &vulkan->pool));
}

void example_close(struct example_vulkan *vulkan)
{
    vkDestroyCommandPool(vulkan->device, vulkan->pool, NULL);
    vkDestroyDevice(vulkan->device, NULL);
    vkDestroyInstance(vulkan->instance, NULL);
}

/* ---- Buffers and commands ---- */

static uint32_t memory_type(const struct example_vulkan *vulkan, uint32_t allowed, VkMemoryPropertyFlags properties)
{
    VkPhysicalDeviceMemoryProperties memory;
    uint32_t i;
    vkGetPhysicalDeviceMemoryProperties(vulkan->physical, &memory);
    for (i = 0; i < memory.memoryTypeCount; i++)
        if (allowed >> i & 1 && (memory.memoryTypes[i].propertyFlags & properties) == properties)
            return i;
    fprintf(stderr, "no such memory\n");
    exit(1);
}

struct example_buffer example_buffer(const struct example_vulkan *vulkan, VkDeviceSize size, VkBufferUsageFlags usage,
                                     VkMemoryPropertyFlags properties)
{
    struct example_buffer buffer = {.size = size};
    const int has_address = (usage & VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT) != 0;
    const VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .size = size, .usage = usage};
    const VkMemoryAllocateFlagsInfo flags = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
                                             .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
    VkMemoryAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                       .pNext = has_address ? &flags : NULL};
    VkMemoryRequirements needed;
    example_check("vkCreateBuffer", vkCreateBuffer(vulkan->device, &info, NULL, &buffer.buffer));
    vkGetBufferMemoryRequirements(vulkan->device, buffer.buffer, &needed);
    allocation.allocationSize = needed.size;
    allocation.memoryTypeIndex = memory_type(vulkan, needed.memoryTypeBits, properties);
    example_check("vkAllocateMemory", vkAllocateMemory(vulkan->device, &allocation, NULL, &buffer.memory));
    example_check("vkBindBufferMemory", vkBindBufferMemory(vulkan->device, buffer.buffer, buffer.memory, 0));
    if (properties & VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT)
        example_check("vkMapMemory",
                      vkMapMemory(vulkan->device, buffer.memory, 0, VK_WHOLE_SIZE, 0, (void **)&buffer.mapped));
    if (has_address) {
        const VkBufferDeviceAddressInfo which = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO,
                                                 .buffer = buffer.buffer};
        buffer.address = vkGetBufferDeviceAddress(vulkan->device, &which);
    }
    return buffer;
}

void example_free(const struct example_vulkan *vulkan, struct example_buffer *buffer)
{
    vkDestroyBuffer(vulkan->device, buffer->buffer, NULL);
    vkFreeMemory(vulkan->device, buffer->memory, NULL);
}

VkCommandBuffer example_begin(const struct example_vulkan *vulkan)
{
    VkCommandBuffer commands;
    const VkCommandBufferAllocateInfo info = {
        .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, .commandPool = vulkan->pool, .commandBufferCount = 1};
    const VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    example_check("vkAllocateCommandBuffers", vkAllocateCommandBuffers(vulkan->device, &info, &commands));
    example_check("vkBeginCommandBuffer", vkBeginCommandBuffer(commands, &begin));
    return commands;
}

void example_submit(const struct example_vulkan *vulkan, VkCommandBuffer commands)
{
    const VkSubmitInfo submit = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &commands};
    example_check("vkEndCommandBuffer", vkEndCommandBuffer(commands));
    example_check("vkQueueSubmit", vkQueueSubmit(vulkan->queue, 1, &submit, VK_NULL_HANDLE));
    example_check("vkQueueWaitIdle", vkQueueWaitIdle(vulkan->queue));
    vkFreeCommandBuffers(vulkan->device, vulkan->pool, 1, &commands);
}

/* ---- The kernel ---- */

struct compute_kernel {
    VkDescriptorSetLayout set_layout;
    VkPipelineLayout layout;
    VkPipeline pipeline;
    VkDescriptorPool pool;
    VkDescriptorSet set;
    uint32_t bindings;
};

static void create_pipeline(VkDevice device, const uint32_t *code, size_t size, struct compute_kernel *kernel)
{
    VkShaderModule module;
    const VkPushConstantRange push = {VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof(uint64_t)};
    const VkPipelineLayoutCreateInfo layout = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                               .setLayoutCount = 1,
                                               .pSetLayouts = &kernel->set_layout,
                                               .pushConstantRangeCount = 1,
                                               .pPushConstantRanges = &push};
    const VkShaderModuleCreateInfo shader = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = size, .pCode = code};
    VkComputePipelineCreateInfo pipeline = {.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                            .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                      .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                      .pName = "main"}};
    example_check("vkCreatePipelineLayout", vkCreatePipelineLayout(device, &layout, NULL, &kernel->layout));
    example_check("vkCreateShaderModule", vkCreateShaderModule(device, &shader, NULL, &module));
    pipeline.stage.module = module;
    pipeline.layout = kernel->layout;
    example_check("vkCreateComputePipelines",
                  vkCreateComputePipelines(device, VK_NULL_HANDLE, 1, &pipeline, NULL, &kernel->pipeline));
    vkDestroyShaderModule(device, module, NULL);
}

/* Binding 0 is the output; binding 1, if there is one, is the scene. */
static void create_set(VkDevice device, VkBuffer distances, const struct example_scene *scene,
                       struct compute_kernel *kernel)
{
    const VkDescriptorType scene_type =
        scene->structure ? VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR : VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    const VkDescriptorSetLayoutBinding bindings[2] = {
        {0, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, NULL},
        {1, scene_type, 1, VK_SHADER_STAGE_COMPUTE_BIT, NULL}};
    const uint32_t count = scene->structure || scene->buffer ? 2 : 1;
    const VkDescriptorSetLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = count, .pBindings = bindings};
    const VkDescriptorPoolSize sizes[2] = {{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 2},
                                           {VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1}};
    const VkDescriptorPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                             .maxSets = 1,
                                             .poolSizeCount = scene->structure ? 2 : 1,
                                             .pPoolSizes = sizes};
    VkDescriptorSetAllocateInfo set = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                       .descriptorSetCount = 1,
                                       .pSetLayouts = &kernel->set_layout};
    const VkDescriptorBufferInfo buffers[2] = {{distances, 0, VK_WHOLE_SIZE}, {scene->buffer, 0, VK_WHOLE_SIZE}};
    const VkWriteDescriptorSetAccelerationStructureKHR structure = {
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = 1,
        .pAccelerationStructures = &scene->structure};
    VkWriteDescriptorSet writes[2];
    uint32_t i;
    example_check("vkCreateDescriptorSetLayout",
                  vkCreateDescriptorSetLayout(device, &layout, NULL, &kernel->set_layout));
    example_check("vkCreateDescriptorPool", vkCreateDescriptorPool(device, &pool, NULL, &kernel->pool));
    set.descriptorPool = kernel->pool;
    example_check("vkAllocateDescriptorSets", vkAllocateDescriptorSets(device, &set, &kernel->set));
    for (i = 0; i < count; i++) {
        const VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                            .pNext = i == 1 && scene->structure ? &structure : NULL,
                                            .dstSet = kernel->set,
                                            .dstBinding = i,
                                            .descriptorCount = 1,
                                            .descriptorType = bindings[i].descriptorType,
                                            .pBufferInfo = &buffers[i]};
        writes[i] = write;
    }
    vkUpdateDescriptorSets(device, count, writes, 0, NULL);
}

static void print_distances(const float *distances)
{
    uint32_t hits = 0, i;
    double sum = 0;
    for (i = 0; i < RAYS; i++)
        if (distances[i] >= 0) {
            hits++;
            sum += (double)distances[i];
        }
    printf("%u of %u rays hit something, after %.3f in all\n", (unsigned)hits, (unsigned)RAYS, sum);
}

void example_trace(const struct example_vulkan *vulkan, const uint32_t *code, size_t size,
                   const struct example_scene *scene)
{
    const VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                     .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                                     .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    struct example_buffer distances =
        example_buffer(vulkan, RAYS * sizeof(float), VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
                       VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
    struct compute_kernel kernel = {.bindings = 0};
    VkCommandBuffer commands;
    create_set(vulkan->device, distances.buffer, scene, &kernel);
    create_pipeline(vulkan->device, code, size, &kernel);
    commands = example_begin(vulkan);
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, kernel.pipeline);
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, kernel.layout, 0, 1, &kernel.set, 0, NULL);
    vkCmdPushConstants(commands, kernel.layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof scene->root, &scene->root);
    vkCmdDispatch(commands, RAYS / GROUP, 1, 1);
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0,
                         NULL, 0, NULL);
    example_submit(vulkan, commands);
    print_distances((const float *)(const void *)distances.mapped);
    vkDestroyPipeline(vulkan->device, kernel.pipeline, NULL);
    vkDestroyPipelineLayout(vulkan->device, kernel.layout, NULL);
    vkDestroyDescriptorPool(vulkan->device, kernel.pool, NULL);
    vkDestroyDescriptorSetLayout(vulkan->device, kernel.set_layout, NULL);
    example_free(vulkan, &distances);
}
