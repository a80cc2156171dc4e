/* SPDX-License-Identifier: Apache-2.0 */
/*
 * load_scene.c - loads a scene in the shortest way: bvhd_vulkan_scene_create allocates, uploads and waits. The
 * structures are portable, a compute shader finds them by their addresses and traverses them; any device with buffer
 * addresses can do this.
 */
#include <stdio.h>

#include <bvhd/bvhd_vulkan.h>

#include "example_scene.h"
#include "example_vulkan.h"
#include "rays_addresses.h" /* rays.comp as SPIR-V */

int main(void)
{
    struct example_vulkan vulkan;
    struct example_build build;
    struct bvhd_vulkan_device *device;
    struct bvhd_vulkan_scene *scene;
    struct bvhd_vulkan_bytes blobs[EXAMPLE_BLOBS];
    struct example_scene traced = {.structure = VK_NULL_HANDLE};
    struct bvhd_error error;
    int i;

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
    example_build_end(&build); /* the device has its own copy of the bytes now */

    traced.root = bvhd_vulkan_scene_location(scene, EXAMPLE_BLOBS - 1);
    example_trace(&vulkan, rays_addresses, sizeof rays_addresses, &traced);

    bvhd_vulkan_scene_destroy(scene);
    bvhd_vulkan_device_destroy(device);
    example_close(&vulkan);
    return 0;
}
