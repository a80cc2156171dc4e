/* SPDX-License-Identifier: Apache-2.0 */
/*
 * load_portable.c - loads portable structures into the program's own storage buffer, on any device with compute
 * shaders. One buffer holds the whole scene, and locations are offsets in it.
 */
#include <stdio.h>

#include <bvhd/bvhd_vulkan.h>

#include "example_scene.h"
#include "example_vulkan.h"
#include "rays_portable.h" /* rays.comp as SPIR-V */

static VkDeviceSize align(VkDeviceSize offset, VkDeviceSize alignment)
{
    return (offset + alignment - 1) / alignment * alignment;
}

static struct bvhd_vulkan_device *create_device(const struct example_vulkan *vulkan)
{
    struct bvhd_vulkan_device *device;
    struct bvhd_error error;
    const struct bvhd_vulkan_device_options options = {.struct_size = sizeof options,
                                                       .get_instance_proc_addr = vkGetInstanceProcAddr,
                                                       .instance = vulkan->instance,
                                                       .physical_device = vulkan->physical,
                                                       .device = vulkan->device};
    example_must(bvhd_vulkan_device_create(&options, &device, &error), &error);
    return device;
}

int main(void)
{
    struct example_vulkan vulkan;
    struct example_build build;
    struct bvhd_vulkan_requirements needed[EXAMPLE_BLOBS];
    /* the location of each structure: the top level's root, and what its instances name */
    uint64_t places[EXAMPLE_BLOBS];
    VkDeviceSize sources[EXAMPLE_BLOBS], storage_size = 0, staging_size = 0;
    struct example_scene traced = {.structure = VK_NULL_HANDLE};
    struct bvhd_error error;
    int i;

    example_open(&vulkan, EXAMPLE_COMPUTE);
    struct bvhd_vulkan_device *device = create_device(&vulkan);
    example_build(&build, NULL);

    /* All structures go into one buffer. Bytes from elsewhere are checked before anything else is done with them. */
    for (i = 0; i < EXAMPLE_BLOBS; i++) {
        const struct bvhd_result *result = build.results[i];
        example_must(bvhd_vulkan_check(device, NULL, result->data, result->size, &error), &error);
        example_must(bvhd_vulkan_requirements(device, result->data, result->size, &needed[i], &error), &error);
        places[i] = align(storage_size, needed[i].storage_alignment);
        sources[i] = align(staging_size, needed[i].staging_alignment);
        storage_size = places[i] + needed[i].storage_size;
        staging_size = sources[i] + needed[i].staging_size;
    }
    struct example_buffer storage =
        example_buffer(&vulkan, storage_size, needed[0].storage_usage, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
    struct example_buffer staging =
        example_buffer(&vulkan, staging_size, needed[0].staging_usage,
                       VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);

    /* All uploads go into one command buffer, followed by one barrier. */
    VkCommandBuffer commands = example_begin(&vulkan);
    for (i = 0; i < EXAMPLE_BLOBS; i++) {
        VkAccelerationStructureKHR none;
        const struct bvhd_vulkan_upload upload = {.struct_size = sizeof upload,
                                                  .data = build.results[i]->data,
                                                  .size = build.results[i]->size,
                                                  .staging = {staging.buffer, sources[i], needed[i].staging_size},
                                                  .staging_mapped = staging.mapped + sources[i],
                                                  .storage = {storage.buffer, places[i], needed[i].storage_size},
                                                  .references = places,
                                                  .reference_count = EXAMPLE_BOTTOMS};
        example_must(bvhd_vulkan_record_upload(device, commands, &upload, &none, &error), &error);
    }
    bvhd_vulkan_record_barrier(device, commands);
    example_submit(&vulkan, commands);
    example_free(&vulkan, &staging);
    example_build_end(&build);

    traced.buffer = storage.buffer;
    traced.root = places[EXAMPLE_BOTTOMS];
    example_trace(&vulkan, rays_portable, sizeof rays_portable, &traced);

    example_free(&vulkan, &storage);
    bvhd_vulkan_device_destroy(device);
    example_close(&vulkan);
    return 0;
}
