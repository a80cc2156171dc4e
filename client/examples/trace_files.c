/* SPDX-License-Identifier: Apache-2.0 */
/*
 * trace_files.c - the shortest program that traces the rays of a file (one struct bvhd_ray after the other) through
 * structures of `bvhctl build` (bottom levels in order, the top level last), and prints hits and rays a second:
 *
 *     cc trace_files.c $(pkg-config --cflags --libs bvhd) -lvulkan && ./a.out RAYS STRUCTURE.as...
 */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <bvhd/bvhd_trace.h>

enum { MAX_BLOBS = 4096, WARM_UP = 8, LAUNCHES = 64 };

static struct bvhd_error error;

static void must(int failed, const char *what)
{
    if (failed) {
        fprintf(stderr, "%s: %d %s %s\n", what, failed, error.where, error.text);
        exit(1);
    }
}

static struct bvhd_vulkan_bytes read_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    must(!file || fseek(file, 0, SEEK_END), path);
    const size_t size = (size_t)ftell(file);
    void *data = malloc(size);
    rewind(file);
    must(!data || fread(data, 1, size, file) != size, path);
    fclose(file);
    return (struct bvhd_vulkan_bytes){data, size};
}

/* Makes a storage buffer in memory of the device that the host can write and read, and maps it. */
static VkBuffer make_buffer(VkPhysicalDevice physical, VkDevice device, VkDeviceSize size, void **ret_mapped)
{
    const VkMemoryPropertyFlags wanted = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT | VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT;
    const VkBufferCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .size = size, .usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT};
    VkBuffer buffer;
    must(vkCreateBuffer(device, &info, NULL, &buffer), "vkCreateBuffer");
    VkPhysicalDeviceMemoryProperties memory;
    VkMemoryRequirements needed;
    vkGetPhysicalDeviceMemoryProperties(physical, &memory);
    vkGetBufferMemoryRequirements(device, buffer, &needed);
    uint32_t type = 0;
    while (type < memory.memoryTypeCount &&
           (!(needed.memoryTypeBits >> type & 1) || (memory.memoryTypes[type].propertyFlags & wanted) != wanted))
        type++;
    const VkMemoryAllocateInfo allocation = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, NULL, needed.size, type};
    VkDeviceMemory block;
    must(vkAllocateMemory(device, &allocation, NULL, &block), "vkAllocateMemory");
    must(vkBindBufferMemory(device, buffer, block, 0), "vkBindBufferMemory");
    must(vkMapMemory(device, block, 0, VK_WHOLE_SIZE, 0, ret_mapped), "vkMapMemory");
    return buffer;
}

/* Records some launches, each of which waits for the one before it; returns the seconds that they take. */
static double launch(VkQueue queue, VkCommandBuffer commands, const struct bvhd_trace_binding *binding,
                     const struct bvhd_trace *trace, int launches)
{
    const VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    const VkMemoryBarrier after = {VK_STRUCTURE_TYPE_MEMORY_BARRIER, NULL, VK_ACCESS_SHADER_WRITE_BIT,
                                   VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_HOST_READ_BIT};
    const VkPipelineStageFlags compute = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, host = VK_PIPELINE_STAGE_HOST_BIT;
    const VkSubmitInfo submit = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &commands};
    struct timespec start, end;
    must(vkBeginCommandBuffer(commands, &begin), "vkBeginCommandBuffer");
    for (int i = 0; i < launches; i++) {
        must(bvhd_tracer_record(binding, commands, trace, &error), "bvhd_tracer_record");
        vkCmdPipelineBarrier(commands, compute, compute | host, 0, 1, &after, 0, NULL, 0, NULL);
    }
    must(vkEndCommandBuffer(commands), "vkEndCommandBuffer");
    clock_gettime(CLOCK_MONOTONIC, &start);
    must(vkQueueSubmit(queue, 1, &submit, VK_NULL_HANDLE) || vkQueueWaitIdle(queue), "vkQueueSubmit");
    clock_gettime(CLOCK_MONOTONIC, &end);
    return (double)(end.tv_sec - start.tv_sec) + 1e-9 * (double)(end.tv_nsec - start.tv_nsec);
}

int main(int argc, char **argv)
{
    must(argc < 3 || argc > MAX_BLOBS + 2, "usage: trace_files RAYS STRUCTURE.as...");
    struct bvhd_vulkan_bytes blobs[MAX_BLOBS], rays = read_file(argv[1]);
    for (int i = 2; i < argc; i++)
        blobs[i - 2] = read_file(argv[i]);

    /* The first device and its first queue family, with the two features that make tracing faster. */
    const VkApplicationInfo application = {.apiVersion = VK_API_VERSION_1_2};
    const VkInstanceCreateInfo instance_info = {VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                                .pApplicationInfo = &application};
    VkInstance instance;
    VkPhysicalDevice physical;
    uint32_t one = 1;
    must(vkCreateInstance(&instance_info, NULL, &instance), "vkCreateInstance");
    must(vkEnumeratePhysicalDevices(instance, &one, &physical) < 0 || one == 0, "there is no Vulkan device");
    const float priority = 1;
    const VkDeviceQueueCreateInfo queue_info = {VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, .queueCount = 1,
                                                .pQueuePriorities = &priority};
    VkPhysicalDeviceVulkan12Features addresses = {VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
                                                  .bufferDeviceAddress = VK_TRUE};
    const VkPhysicalDeviceFeatures doubles = {.shaderFloat64 = VK_TRUE};
    const VkDeviceCreateInfo device_info = {VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, &addresses, .queueCreateInfoCount = 1,
                                            .pQueueCreateInfos = &queue_info, .pEnabledFeatures = &doubles};
    struct bvhd_vulkan_device_options options = {sizeof options, .get_instance_proc_addr = vkGetInstanceProcAddr,
                                                 .instance = instance, .physical_device = physical,
                                                 .has_buffer_device_address = VK_TRUE};
    must(vkCreateDevice(physical, &device_info, NULL, &options.device), "vkCreateDevice");
    struct bvhd_vulkan_queue queue = {.family = 0};
    vkGetDeviceQueue(options.device, 0, 0, &queue.queue);

    struct bvhd_vulkan_device *device;
    struct bvhd_vulkan_scene *scene;
    struct bvhd_tracer *tracer;
    struct bvhd_trace_binding *binding;
    must(bvhd_vulkan_device_create(&options, &device, &error), "bvhd_vulkan_device_create");
    const struct bvhd_vulkan_scene_options structures = {
        sizeof structures, .blobs = blobs, .blob_count = (uint32_t)argc - 2, .flags = BVHD_VULKAN_SCENE_ADDRESSES};
    must(bvhd_vulkan_scene_create(device, &queue, &structures, &scene, &error), "bvhd_vulkan_scene_create");
    const struct bvhd_tracer_options kernels = {sizeof kernels, .scene = scene, .root = (uint32_t)argc - 3,
                                                .has_shader_float64 = VK_TRUE};
    must(bvhd_tracer_create(device, &queue, &kernels, &tracer, &error), "bvhd_tracer_create");

    void *input, *output;
    const uint32_t count = (uint32_t)(rays.size / sizeof(struct bvhd_ray));
    const VkDeviceSize hits_size = count * sizeof(struct bvhd_hit);
    const struct bvhd_trace_buffers buffers = {
        sizeof buffers,
        {make_buffer(physical, options.device, rays.size, &input), 0, count * sizeof(struct bvhd_ray)},
        {make_buffer(physical, options.device, hits_size, &output), 0, hits_size},
        .max_rays = count};
    must(bvhd_tracer_bind(tracer, &buffers, &binding, &error), "bvhd_tracer_bind");
    memcpy(input, rays.data, rays.size);

    const VkCommandPoolCreateInfo pool_info = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                               .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT};
    VkCommandBufferAllocateInfo commands_info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                                 .commandBufferCount = 1};
    VkCommandBuffer commands;
    must(vkCreateCommandPool(options.device, &pool_info, NULL, &commands_info.commandPool), "vkCreateCommandPool");
    must(vkAllocateCommandBuffers(options.device, &commands_info, &commands), "vkAllocateCommandBuffers");
    const struct bvhd_trace trace = {sizeof trace, count,
                                     .order = bvhd_rays_order(rays.data, count, sizeof(struct bvhd_ray))};
    launch(queue.queue, commands, binding, &trace, WARM_UP);
    const double seconds = launch(queue.queue, commands, binding, &trace, LAUNCHES);

    const struct bvhd_hit *hits = output;
    uint32_t hit = 0;
    for (uint32_t i = 0; i < count; i++)
        hit += hits[i].instance != BVHD_NO_INSTANCE || hits[i].t < 3.4e38f;
    printf("%u of %u rays hit something; %.1f million rays a second\n", hit, count, 1e-6 * count * LAUNCHES / seconds);
    return 0; /* the end of the process frees everything */
}
