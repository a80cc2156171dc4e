/* SPDX-License-Identifier: Apache-2.0 */
/*
 * trace_rays.c - traces the rays of one buffer into the hits of another by the library's own kernels (bvhd_trace.h),
 * and prints how many rays a second that is: 4,096 rays through a small scene, which the service builds. It measures by
 * the device's clock. trace_files.c is shorter, and traces rays and structures of files.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <bvhd/bvhd_trace.h>

#include "example_scene.h"
#include "example_vulkan.h"

enum { SIDE = 64, LAUNCHES = 21, HOST = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT };

/* Makes rays straight down over [0, 4) x [0, 4), like those of rays.comp. */
static struct bvhd_vulkan_bytes make_rays(void)
{
    struct bvhd_vulkan_bytes bytes = {NULL, SIDE * SIDE * sizeof(struct bvhd_ray)};
    struct bvhd_ray *rays = calloc(SIDE * SIDE, sizeof *rays);
    int i;
    for (i = 0; rays && i < SIDE * SIDE; i++) {
        const struct bvhd_ray ray = {
            .origin = {((float)(i % SIDE) + 0.25f) / 16, ((float)(i / SIDE) + 0.5f) / 16, 10},
            .direction = {0, 0, -1},
            .tmax = 100,
            .mask = 0xff,
        };
        rays[i] = ray;
    }
    bytes.data = rays;
    return bytes;
}

static void print_hits(const struct bvhd_hit *hits, uint32_t count)
{
    uint32_t hit = 0, i;
    double sum = 0;
    for (i = 0; i < count; i++)
        if (hits[i].t <= 3.4e38f) {
            hit++;
            sum += (double)hits[i].t;
        }
    printf("%u of %u rays hit something, after %.3f in all\n", (unsigned)hit, (unsigned)count, sum);
}

static int compare_ticks(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

/* Records many launches one after the other, each between two timestamps, and prints the rate of the median. */
static void measure(const struct example_vulkan *vulkan, const struct bvhd_trace_binding *binding,
                    const struct bvhd_trace *trace)
{
    const VkQueryPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                        .queryType = VK_QUERY_TYPE_TIMESTAMP,
                                        .queryCount = 2 * LAUNCHES};
    const VkMemoryBarrier next = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                  .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                                  .dstAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_SHADER_READ_BIT};
    VkPhysicalDeviceProperties properties;
    uint64_t ticks[2 * LAUNCHES], times[LAUNCHES];
    VkQueryPool pool;
    VkCommandBuffer commands = example_begin(vulkan);
    struct bvhd_error error;
    uint32_t i;
    example_check("vkCreateQueryPool", vkCreateQueryPool(vulkan->device, &info, NULL, &pool));
    vkCmdResetQueryPool(commands, pool, 0, 2 * LAUNCHES);
    for (i = 0; i < LAUNCHES; i++) {
        vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, pool, 2 * i);
        example_must(bvhd_tracer_record(binding, commands, trace, &error), &error);
        vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, pool, 2 * i + 1);
        vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, 0, 1,
                             &next, 0, NULL, 0, NULL);
    }
    example_submit(vulkan, commands);
    vkGetPhysicalDeviceProperties(vulkan->physical, &properties);
    if (vkGetQueryPoolResults(vulkan->device, pool, 0, 2 * LAUNCHES, sizeof ticks, ticks, sizeof ticks[0],
                              VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT) == VK_SUCCESS) {
        for (i = 0; i < LAUNCHES; i++)
            times[i] = ticks[2 * i + 1] - ticks[2 * i];
        qsort(times, LAUNCHES, sizeof times[0], compare_ticks);
        printf("%s: %.1f million rays a second (the median of %d launches)\n", properties.deviceName,
               trace->ray_count / ((double)times[LAUNCHES / 2] * (double)properties.limits.timestampPeriod) * 1e3,
               LAUNCHES);
    }
    vkDestroyQueryPool(vulkan->device, pool, NULL);
}

/* Traces once for the hits, then measures. */
static void run(const struct example_vulkan *vulkan, const struct bvhd_tracer *tracer, struct bvhd_vulkan_bytes rays)
{
    const uint32_t count = (uint32_t)(rays.size / sizeof(struct bvhd_ray));
    const VkDeviceSize rays_size = count * sizeof(struct bvhd_ray), hits_size = count * sizeof(struct bvhd_hit);
    const VkBufferUsageFlags storage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, from = VK_BUFFER_USAGE_TRANSFER_SRC_BIT,
                             to = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    const VkMemoryPropertyFlags local = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
    const VkBufferCopy up = {0, 0, rays_size}, down = {0, 0, hits_size};
    const VkMemoryBarrier before = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                    .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                                    .dstAccessMask = VK_ACCESS_SHADER_READ_BIT};
    const VkMemoryBarrier after = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                   .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                                   .dstAccessMask = VK_ACCESS_TRANSFER_READ_BIT};
    const VkMemoryBarrier back = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                  .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                                  .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    struct example_buffer upload = example_buffer(vulkan, rays_size, from, HOST);
    struct example_buffer input = example_buffer(vulkan, rays_size, storage | to, local);
    struct example_buffer output = example_buffer(vulkan, hits_size, storage | from, local);
    struct example_buffer readback = example_buffer(vulkan, hits_size, to, HOST);
    const struct bvhd_trace_buffers buffers = {.struct_size = sizeof buffers,
                                               .rays = {input.buffer, 0, rays_size},
                                               .hits = {output.buffer, 0, hits_size},
                                               .max_rays = count};
    const struct bvhd_trace trace = {.struct_size = sizeof trace,
                                     .ray_count = count,
                                     .order = bvhd_rays_order(rays.data, count, sizeof(struct bvhd_ray))};
    struct bvhd_trace_binding *binding;
    struct bvhd_error error;
    VkCommandBuffer commands;
    memcpy(upload.mapped, rays.data, rays_size);
    example_must(bvhd_tracer_bind(tracer, &buffers, &binding, &error), &error);

    commands = example_begin(vulkan);
    vkCmdCopyBuffer(commands, upload.buffer, input.buffer, 1, &up);
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, 0, 1, &before,
                         0, NULL, 0, NULL);
    example_must(bvhd_tracer_record(binding, commands, &trace, &error), &error);
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 1, &after,
                         0, NULL, 0, NULL);
    vkCmdCopyBuffer(commands, output.buffer, readback.buffer, 1, &down);
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &back, 0, NULL, 0,
                         NULL);
    example_submit(vulkan, commands);
    measure(vulkan, binding, &trace);
    print_hits((const struct bvhd_hit *)(const void *)readback.mapped, count);

    bvhd_trace_binding_destroy(binding);
    example_free(vulkan, &upload);
    example_free(vulkan, &input);
    example_free(vulkan, &output);
    example_free(vulkan, &readback);
}

int main(void)
{
    struct bvhd_vulkan_bytes blobs[EXAMPLE_BLOBS], rays = make_rays();
    struct example_vulkan vulkan;
    struct example_build build;
    struct bvhd_vulkan_device *device;
    struct bvhd_vulkan_scene *scene;
    struct bvhd_tracer *tracer;
    struct bvhd_error error;
    uint32_t i;

    if (!rays.data) {
        fprintf(stderr, "no memory for the rays\n");
        return 1;
    }
    example_open(&vulkan, EXAMPLE_ADDRESSES);
    const struct bvhd_vulkan_device_options options = {.struct_size = sizeof options,
                                                       .get_instance_proc_addr = vkGetInstanceProcAddr,
                                                       .instance = vulkan.instance,
                                                       .physical_device = vulkan.physical,
                                                       .device = vulkan.device,
                                                       .has_buffer_device_address = VK_TRUE};
    const struct bvhd_vulkan_queue queue = {vulkan.queue, vulkan.family};
    example_must(bvhd_vulkan_device_create(&options, &device, &error), &error);

    example_build(&build, NULL);
    for (i = 0; i < EXAMPLE_BLOBS; i++) {
        blobs[i].data = build.results[i]->data;
        blobs[i].size = build.results[i]->size;
    }
    const struct bvhd_vulkan_scene_options what = {
        .struct_size = sizeof what, .blobs = blobs, .blob_count = EXAMPLE_BLOBS, .flags = BVHD_VULKAN_SCENE_ADDRESSES};
    example_must(bvhd_vulkan_scene_create(device, &queue, &what, &scene, &error), &error);
    const struct bvhd_tracer_options kernels = {.struct_size = sizeof kernels,
                                                .scene = scene,
                                                .root = EXAMPLE_BLOBS - 1,
                                                .has_shader_float64 = vulkan.has_float64};
    example_must(bvhd_tracer_create(device, &queue, &kernels, &tracer, &error), &error);

    run(&vulkan, tracer, rays);

    bvhd_tracer_destroy(tracer);
    bvhd_vulkan_scene_destroy(scene);
    example_build_end(&build);
    free((void *)(uintptr_t)rays.data);
    bvhd_vulkan_device_destroy(device);
    example_close(&vulkan);
    return 0;
}
