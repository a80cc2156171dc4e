/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/driver/driver_scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/build.h"
#include "tests/support/builder/moved_build.h"
#include "tests/support/driver/gpu_bed.h"
#include "builder/format/serialized.h"

void driver_scene_must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "%s: %s\n", error->where, error->text);
    exit(1);
}

#define MUST(call) driver_scene_must((call), &error)

static void *allocate(struct memory *memory, uint64_t count, uint64_t size)
{
    void *block = memory_array(memory, count + 1, size);
    if (!block) {
        fprintf(stderr, "driver_scene: no memory\n");
        exit(1);
    }
    memset(block, 0, (count + 1) * size);
    return block;
}

/* The index of the bottom level of a row of the top level. */
static uint32_t bottom_of(const struct canonical *top, uint32_t row)
{
    uint64_t number;
    memcpy(&number, &top->references[row].key, sizeof number);
    return (uint32_t)number - 1;
}

/* ---- The driver's structures ---- */

static void build_driver(struct driver_scene *scene, const struct driver_scene_options *options)
{
    struct bvhd_error error;
    const struct canonical *bottoms = options->driver_bottoms ? options->driver_bottoms : options->bottoms;
    uint64_t *addresses = allocate(&scene->memory, scene->row_count, sizeof *addresses);
    for (uint32_t row = 0; row < scene->row_count; row++) {
        uint32_t bottom = bottom_of(options->top, row);
        MUST(driver_structure_build(scene->gpu, &bottoms[bottom], NULL, &scene->memory, &scene->bottoms[row], &error));
        addresses[row] = scene->bottoms[row].address;
    }
    MUST(driver_structure_build(scene->gpu, options->top, addresses, &scene->memory, &scene->top, &error));
    memory_free(&scene->memory, addresses);
}

/* ---- Our structures ---- */

static void build_blob(struct driver_scene *scene, const struct driver_scene_options *options,
                       const struct canonical *canonical, struct bvhd_vulkan_bytes *ret_blob)
{
    struct bvhd_error error;
    struct build_options how = {.quality = options->quality,
                                .target = (enum target)options->format->target,
                                .device.variant = options->format->variant,
                                .builder = options->builder};
    struct build_context context = {.memory = &scene->memory, .parallel = options->parallel};
    struct build_stats stats;
    unsigned char *blob;
    memcpy(how.device.driver_uuid, options->format->driver_uuid, sizeof how.device.driver_uuid);
    memcpy(how.device.compatibility_uuid, options->format->compatibility_uuid, sizeof how.device.compatibility_uuid);
    if (options->updates)
        MUST(moved_build(canonical, &how, &context, &blob, &stats, &error));
    else
        MUST(build(canonical, &how, &context, &blob, &stats, &error));
    *ret_blob = (struct bvhd_vulkan_bytes){blob, stats.sizes.total};
}

static void build_ours(struct driver_scene *scene, const struct driver_scene_options *options)
{
    struct bvhd_error error;
    for (uint32_t row = 0; row < scene->row_count; row++)
        build_blob(scene, options, &options->bottoms[bottom_of(options->top, row)], &scene->blobs[row]);
    build_blob(scene, options, options->top, &scene->blobs[scene->row_count]);
    const struct bvhd_vulkan_scene_options upload = {.struct_size = sizeof upload,
                                                     .blobs = scene->blobs,
                                                     .blob_count = scene->row_count + 1,
                                                     .format = options->format};
    MUST(bvhd_vulkan_scene_create(scene->gpu->library, &scene->gpu->queue, &upload, &scene->ours, &error));
}

/* ---- Boxes ---- */

static uint32_t count_boxes(const struct driver_scene_options *options)
{
    uint32_t count = 0;
    for (uint32_t b = 0; b < options->bottom_count; b++)
        for (uint32_t g = 0; g < options->bottoms[b].geometry_count; g++)
            count += options->bottoms[b].geometries[g].boxes ? options->bottoms[b].geometries[g].primitive_count : 0;
    return count;
}

static void collect_boxes(struct driver_scene *scene, const struct driver_scene_options *options)
{
    const struct canonical_geometry *instances = &options->top->geometries[0];
    uint32_t stride = 1, used = 0;
    for (uint32_t b = 0; b < options->bottom_count; b++)
        stride = options->bottoms[b].geometry_count > stride ? options->bottoms[b].geometry_count : stride;
    float *boxes = allocate(&scene->memory, count_boxes(options), 6 * sizeof *boxes);
    uint32_t *rows = allocate(&scene->memory, (uint64_t)options->bottom_count * stride, sizeof *rows);
    uint32_t *first = allocate(&scene->memory, ((uint64_t)instances->primitive_count + 1) * stride, sizeof *first);
    for (uint32_t b = 0; b < options->bottom_count; b++)
        for (uint32_t g = 0; g < options->bottoms[b].geometry_count; g++) {
            const struct canonical_geometry *geometry = &options->bottoms[b].geometries[g];
            rows[b * stride + g] = used;
            if (!geometry->boxes)
                continue;
            memcpy(boxes + 6 * (size_t)used, geometry->boxes, (size_t)24 * geometry->primitive_count);
            used += geometry->primitive_count;
        }
    for (uint32_t i = 0; i < instances->primitive_count; i++) {
        struct canonical_instance instance = canonical_instance(instances, i);
        if (instance.reference)
            memcpy(first + (size_t)i * stride,
                   rows + (size_t)bottom_of(options->top, (uint32_t)instance.reference - 1) * stride,
                   stride * sizeof *first);
    }
    memory_free(&scene->memory, rows);
    /* At least one of each, because a buffer cannot be empty. */
    scene->boxes = (struct scene_boxes){.boxes = boxes,
                                        .box_count = used + 1,
                                        .instance_count = instances->primitive_count + 1,
                                        .geometry_stride = stride,
                                        .first = first};
}

/* ---- Both ---- */

void driver_scene_init(struct driver_scene *ret_scene, const struct driver_scene_options *options)
{
    struct driver_scene *scene = ret_scene;
    *scene =
        (struct driver_scene){.options = *options, .gpu = options->gpu, .row_count = options->top->reference_count};
    memory_init(&scene->memory, UINT64_MAX);
    scene->bottoms = allocate(&scene->memory, scene->row_count, sizeof *scene->bottoms);
    scene->blobs = allocate(&scene->memory, scene->row_count, sizeof *scene->blobs);
    build_driver(scene, options);
    build_ours(scene, options);
    collect_boxes(scene, options);
}

void driver_scene_finish(struct driver_scene *scene)
{
    bvhd_vulkan_scene_destroy(scene->ours);
    driver_structure_destroy(scene->gpu, &scene->top);
    for (uint32_t row = 0; row < scene->row_count; row++)
        driver_structure_destroy(scene->gpu, &scene->bottoms[row]);
    for (uint32_t row = 0; row <= scene->row_count; row++)
        memory_free(&scene->memory, (void *)(uintptr_t)scene->blobs[row].data);
    memory_free(&scene->memory, (void *)(uintptr_t)scene->boxes.boxes);
    memory_free(&scene->memory, (void *)(uintptr_t)scene->boxes.first);
    memory_free(&scene->memory, scene->blobs);
    memory_free(&scene->memory, scene->bottoms);
    if (scene->memory.live) {
        fprintf(stderr, "driver_scene: %llu bytes are left\n", (unsigned long long)scene->memory.live);
        exit(1);
    }
}

uint32_t driver_scene_bottom(const struct driver_scene *scene, uint32_t row)
{
    return bottom_of(scene->options.top, row);
}

VkAccelerationStructureKHR driver_scene_our_top(const struct driver_scene *scene)
{
    return bvhd_vulkan_scene_structure(scene->ours, scene->row_count);
}

struct driver_structure driver_scene_ours(const struct driver_scene *scene, uint32_t row)
{
    struct bvhd_error error;
    struct serialized_header header;
    const struct bytes blob = {scene->blobs[row].data, scene->blobs[row].size};
    MUST(serialized_read(blob, &header, &error));
    return (struct driver_structure){.handle = bvhd_vulkan_scene_structure(scene->ours, row),
                                     .type = row == scene->row_count ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                                                     : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
                                     .address = bvhd_vulkan_scene_location(scene->ours, row),
                                     .size = header.deserialized_size};
}

struct driver_structure driver_scene_top_over(struct driver_scene *scene, const uint64_t *addresses)
{
    struct bvhd_error error;
    struct serialized_header header;
    struct driver_structure top;
    const struct bvhd_vulkan_bytes *blob = &scene->blobs[scene->row_count];
    unsigned char *copy = allocate(&scene->memory, blob->size, 1);
    memcpy(copy, blob->data, blob->size);
    MUST(serialized_read((struct bytes){copy, blob->size}, &header, &error));
    for (uint64_t i = 0; i < header.handle_count; i++) {
        unsigned char *handle = copy + SERIALIZED_HANDLES + 8 * i;
        bytes_put64(handle, addresses[bytes_get64(handle) - 1]);
    }
    MUST(driver_structure_load(scene->gpu, copy, blob->size, &top, &error));
    memory_free(&scene->memory, copy);
    return top;
}

static enum bvhd_status ask_format(struct gpu *gpu, struct bvhd_format *ret_format, struct bvhd_error *error)
{
    void *probe = NULL;
    uint64_t size;
    enum bvhd_status status = bvhd_vulkan_probe(gpu->library, &gpu->queue, &probe, &size, error);
    if (status == BVHD_OK)
        status = bvhd_format_from_probe(probe, size, ret_format, error);
    bvhd_vulkan_free(probe);
    return status;
}

bool driver_scene_device(struct memory *memory, struct gpu **ret_gpu, struct bvhd_format *ret_format)
{
    struct bvhd_error error = {.status = BVHD_OK};
    struct gpu *gpu;
    if (gpu_bed_is_missing(true))
        return false;
    MUST(gpu_open("auto", memory, &gpu, &error));
    if (ask_format(gpu, ret_format, &error) != BVHD_OK) {
        printf("skipped: %s loads nothing of ours natively: %s: %s\n", gpu->properties.name, error.where, error.text);
        gpu_close(gpu);
        return false;
    }
    *ret_gpu = gpu;
    return true;
}
