/* SPDX-License-Identifier: Apache-2.0 */
/*
 * load_native.c - loads structures of the device's own format into the program's own buffers, for the driver's ray
 * queries. It asks the device which format it loads, has the scene built for it, uploads it, and traces rays.
 */
#include <stdio.h>

#include <bvhd/bvhd_vulkan.h>

#include "example_scene.h"
#include "example_vulkan.h"
#include "rays_native.h" /* rays.comp as SPIR-V */

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
                                                       .device = vulkan->device,
                                                       .has_acceleration_structure = VK_TRUE,
                                                       .has_buffer_device_address = VK_TRUE};
    example_must(bvhd_vulkan_device_create(&options, &device, &error), &error);
    return device;
}

/*
 * Finds the format that the driver loads. That takes milliseconds, and the result stays the same until the driver is
 * updated. BVHD_UNSUPPORTED means that only the portable target can be loaded.
 */
static struct bvhd_format find_format(struct bvhd_vulkan_device *device, const struct example_vulkan *vulkan)
{
    const struct bvhd_vulkan_queue queue = {vulkan->queue, vulkan->family};
    struct bvhd_format format;
    struct bvhd_error error;
    void *probe;
    uint64_t size;
    example_must(bvhd_vulkan_probe(device, &queue, &probe, &size, &error), &error);
    example_must(bvhd_format_from_probe(probe, size, &format, &error), &error);
    bvhd_vulkan_free(probe);
    printf("the device loads %s\n", bvhd_target_name(format.target));
    return format;
}

/* One structure: its storage, and staging memory that is needed until the copy has run. */
struct loaded {
    VkAccelerationStructureKHR structure;
    struct example_buffer storage, staging;
};

static struct loaded upload(struct bvhd_vulkan_device *device, const struct example_vulkan *vulkan,
                            VkCommandBuffer commands, const struct bvhd_format *format,
                            const struct bvhd_result *result, const uint64_t *references)
{
    struct loaded loaded;
    struct bvhd_error error;
    struct bvhd_vulkan_requirements needed;
    VkDeviceSize offset;
    example_must(bvhd_vulkan_check(device, format, result->data, result->size, &error), &error);
    example_must(bvhd_vulkan_requirements(device, result->data, result->size, &needed, &error), &error);
    loaded.storage =
        example_buffer(vulkan, needed.storage_size, needed.storage_usage, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
    loaded.staging = example_buffer(vulkan, needed.staging_size + needed.staging_alignment, needed.staging_usage,
                                    VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
    /* The device address has to be aligned, not the offset. */
    offset = align(loaded.staging.address, needed.staging_alignment) - loaded.staging.address;
    const struct bvhd_vulkan_upload what = {.struct_size = sizeof what,
                                            .data = result->data,
                                            .size = result->size,
                                            .staging = {loaded.staging.buffer, offset, needed.staging_size},
                                            .staging_mapped = loaded.staging.mapped + offset,
                                            .storage = {loaded.storage.buffer, 0, needed.storage_size},
                                            .references = references,
                                            .reference_count = needed.reference_count};
    example_must(bvhd_vulkan_record_upload(device, commands, &what, &loaded.structure, &error), &error);
    return loaded;
}

int main(void)
{
    struct example_vulkan vulkan;
    struct example_build build;
    struct loaded loaded[EXAMPLE_BLOBS];
    uint64_t addresses[EXAMPLE_BLOBS];
    struct example_scene traced = {.structure = VK_NULL_HANDLE};
    int i;

    example_open(&vulkan, EXAMPLE_RAY_QUERIES);
    struct bvhd_vulkan_device *device = create_device(&vulkan);
    const struct bvhd_format format = find_format(device, &vulkan);
    example_build(&build, &format);

    /*
     * Bottom levels come first, because the top level names their addresses. All uploads go into one command buffer,
     * followed by one barrier.
     */
    VkCommandBuffer commands = example_begin(&vulkan);
    for (i = 0; i < EXAMPLE_BLOBS; i++) {
        loaded[i] = upload(device, &vulkan, commands, &format, build.results[i], addresses);
        addresses[i] = bvhd_vulkan_address(device, loaded[i].structure);
    }
    bvhd_vulkan_record_barrier(device, commands);
    example_submit(&vulkan, commands);
    example_build_end(&build);

    traced.structure = loaded[EXAMPLE_BOTTOMS].structure;
    example_trace(&vulkan, rays_native, sizeof rays_native, &traced);

    PFN_vkDestroyAccelerationStructureKHR destroy =
        (PFN_vkDestroyAccelerationStructureKHR)vkGetDeviceProcAddr(vulkan.device, "vkDestroyAccelerationStructureKHR");
    for (i = 0; i < EXAMPLE_BLOBS; i++) {
        destroy(vulkan.device, loaded[i].structure, NULL);
        example_free(&vulkan, &loaded[i].storage);
        example_free(&vulkan, &loaded[i].staging);
    }
    bvhd_vulkan_device_destroy(device);
    example_close(&vulkan);
    return 0;
}
