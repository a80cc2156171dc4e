/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdlib.h>

#include "client/argument.h"
#include "client/library.h"
#include "client/vulkan/vulkan_scene_load.h"
#include "proto/base/place.h"

/* ---- The structures of a scene ---- */

static int by_data(const void *a, const void *b)
{
    const struct vulkan_scene_row *x = a, *y = b;
    if (x->data != y->data)
        return (uintptr_t)x->data < (uintptr_t)y->data ? -1 : 1;
    return x->row < y->row ? -1 : x->row > y->row;
}

static int by_row(const void *a, const void *b)
{
    const struct vulkan_scene_row *x = a, *y = b;
    return x->row < y->row ? -1 : x->row > y->row;
}

static enum bvhd_status list_rows(struct vulkan_scene_loading *loading)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    uint32_t count = loading->options->blob_count;
    scene->rows = memory_array(&library_memory, count, sizeof *scene->rows);
    loading->references = memory_array(&library_memory, count, sizeof *loading->references);
    if (!scene->rows || !loading->references)
        return vulkan_scene_no_memory(loading);
    scene->row_count = count;
    for (uint32_t i = 0; i < count; i++) {
        const struct bvhd_vulkan_bytes *blob = &loading->options->blobs[i];
        scene->rows[i] = (struct vulkan_scene_row){
            .data = blob->data, .size = blob->size, .row = i, .location = VULKAN_SCENE_NOWHERE};
        loading->references[i] = VULKAN_SCENE_NOWHERE;
    }
    qsort(scene->rows, count, sizeof *scene->rows, by_data);
    for (uint32_t i = 0; i < count; i++)
        scene->rows[i].leader =
            i > 0 && scene->rows[i].data == scene->rows[i - 1].data ? scene->rows[i - 1].leader : scene->rows[i].row;
    qsort(scene->rows, count, sizeof *scene->rows, by_row);
    for (uint32_t i = 0; i < count; i++)
        if (scene->rows[i].size != scene->rows[scene->rows[i].leader].size)
            return bvhd_error_set(loading->error, BVHD_INVALID, place("blobs[%" PRIu32 "]", i).text,
                                  "the data of blobs[%" PRIu32 "], with another size", scene->rows[i].leader);
    return BVHD_OK;
}

/*
 * Checks that the device can load a structure, that it has the scene's target, and that it is a bottom level unless it
 * is the last one.
 */
static enum bvhd_status check_row(struct vulkan_scene_loading *loading, const struct bvhd_format *format,
                                  struct vulkan_scene_row *row)
{
    struct bvhd_error inner;
    struct bvhd_vulkan_requirements needed;
    struct bvhd_vulkan_scene *scene = loading->scene;
    enum bvhd_status status = bvhd_vulkan_check(loading->device, format, row->data, row->size, &inner);
    if (status == BVHD_OK)
        status = bvhd_vulkan_requirements(loading->device, row->data, row->size, &needed, &inner);
    if (status == BVHD_OK && scene->target && scene->target != needed.target)
        status = bvhd_error_set(&inner, BVHD_INVALID, "data", "of another target than those before");
    if (status == BVHD_OK && needed.type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR &&
        row->row + 1 < scene->row_count)
        status = bvhd_error_set(&inner, BVHD_INVALID, "data", "a top level that is not the last one");
    if (status != BVHD_OK)
        return vulkan_scene_row_error(loading, row->row, &inner);
    scene->target = needed.target;
    row->storage_size = needed.storage_size;
    row->is_top = needed.type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
    if (needed.target == BVHD_TARGET_PORTABLE)
        vulkan_contents_add(&scene->contents, (struct bytes){row->data, row->size});
    return BVHD_OK;
}

static enum bvhd_status check_rows(struct vulkan_scene_loading *loading, const struct bvhd_format *format)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    for (uint32_t i = 0; i < scene->row_count; i++) {
        enum bvhd_status status =
            vulkan_scene_row_is_loaded(&scene->rows[i]) ? check_row(loading, format, &scene->rows[i]) : BVHD_OK;
        if (status != BVHD_OK)
            return status;
    }
    if (!scene->rows[scene->row_count - 1].data)
        return bvhd_error_set(loading->error, BVHD_INVALID, "blobs",
                              "the last one is the scene's own structure, and there is none");
    return BVHD_OK;
}

/*
 * Returns whether a format has to be found by a probe: a structure is native, and the device supports such structures.
 */
static bool needs_probe(const struct vulkan_scene_loading *loading)
{
    if (loading->options->format || !loading->device->has_structures)
        return false;
    for (uint32_t i = 0; i < loading->scene->row_count; i++) {
        struct vulkan_blob blob;
        const struct vulkan_scene_row *row = &loading->scene->rows[i];
        if (vulkan_scene_row_is_loaded(row) &&
            vulkan_blob_read((struct bytes){row->data, row->size}, &blob, NULL) == BVHD_OK)
            return blob.target != BVHD_TARGET_PORTABLE;
    }
    return false;
}

static enum bvhd_status probe_device(const struct vulkan_scene_loading *loading, struct bvhd_format *ret_format)
{
    void *probe = NULL;
    uint64_t size = 0;
    enum bvhd_status status = bvhd_vulkan_probe(loading->device, loading->queue, &probe, &size, loading->error);
    if (status == BVHD_OK)
        status = bvhd_format_from_probe(probe, size, ret_format, loading->error);
    bvhd_vulkan_free(probe);
    return status;
}

/* ---- Creating a scene ---- */

static enum bvhd_status check_options(const struct bvhd_vulkan_device *device,
                                      const struct bvhd_vulkan_scene_options *options, struct bvhd_error *error)
{
    enum bvhd_status status =
        argument_check_size(options, sizeof *options, sizeof *options, "options", "bvhd_vulkan_scene_options", error);
    if (status != BVHD_OK)
        return status;
    if (options->blob_count == 0)
        return bvhd_error_set(error, BVHD_INVALID, "options.blob_count", "it is 0: there is no structure to load");
    if (!options->blobs)
        return bvhd_error_set(error, BVHD_INVALID, "options.blobs", "options.blobs is NULL, but blob_count is %" PRIu32,
                              options->blob_count);
    if (options->flags & ~(uint32_t)BVHD_VULKAN_SCENE_ADDRESSES)
        return bvhd_error_set(error, BVHD_INVALID, "options.flags",
                              "0x%" PRIx32 " has bits that are no BVHD_VULKAN_SCENE_ flag", options->flags);
    if ((options->flags & BVHD_VULKAN_SCENE_ADDRESSES) && !device->has_addresses)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "options.flags", "the device has no buffer addresses");
    return BVHD_OK;
}

static enum bvhd_status load(struct vulkan_scene_loading *loading)
{
    struct bvhd_format probed;
    const struct bvhd_format *format = loading->options->format;
    enum bvhd_status status = list_rows(loading);
    if (status == BVHD_OK && needs_probe(loading)) {
        status = probe_device(loading, &probed);
        format = &probed;
    }
    if (status == BVHD_OK)
        status = check_rows(loading, format);
    return status == BVHD_OK ? vulkan_scene_load(loading) : status;
}

enum bvhd_status bvhd_vulkan_scene_create(struct bvhd_vulkan_device *device, const struct bvhd_vulkan_queue *queue,
                                          const struct bvhd_vulkan_scene_options *options,
                                          struct bvhd_vulkan_scene **ret_scene, struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {device, "device"}, {queue, "queue"}, {options, "options"},
                                              {ret_scene, "ret_scene"});
    if (status == BVHD_OK)
        status = check_options(device, options, ret_error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_vulkan_scene *scene = memory_alloc(&library_memory, sizeof *scene);
    struct vulkan_scene_loading loading = {
        .device = device, .queue = queue, .options = options, .scene = scene, .error = ret_error};
    if (!scene)
        return vulkan_scene_no_memory(&loading);
    memset(scene, 0, sizeof *scene);
    scene->device = device;
    scene->flags = options->flags;
    status = load(&loading);
    vulkan_work_finish(&loading.work);
    vulkan_buffer_destroy(device, &loading.staging);
    memory_free(&library_memory, loading.references);
    if (status == BVHD_OK)
        *ret_scene = scene;
    else
        bvhd_vulkan_scene_destroy(scene);
    return status;
}

void bvhd_vulkan_scene_destroy(struct bvhd_vulkan_scene *scene)
{
    if (!scene)
        return;
    const struct bvhd_vulkan_device *device = scene->device;
    for (uint32_t i = 0; i < scene->row_count; i++)
        if (vulkan_scene_row_is_loaded(&scene->rows[i]) && scene->rows[i].structure)
            device->vk.DestroyAccelerationStructureKHR(device->handle, scene->rows[i].structure, device->allocator);
    for (uint32_t i = 0; scene->pages && i < scene->page_count; i++)
        vulkan_buffer_destroy(device, &scene->pages[i]);
    memory_free(&library_memory, scene->pages);
    memory_free(&library_memory, scene->rows);
    memory_free(&library_memory, scene);
}

static const struct vulkan_scene_row *row_at(const struct bvhd_vulkan_scene *scene, uint32_t index)
{
    return scene && index < scene->row_count && scene->rows[index].data ? &scene->rows[index] : NULL;
}

enum bvhd_target bvhd_vulkan_scene_target(const struct bvhd_vulkan_scene *scene)
{
    return scene ? scene->target : 0;
}

VkAccelerationStructureKHR bvhd_vulkan_scene_structure(const struct bvhd_vulkan_scene *scene, uint32_t index)
{
    const struct vulkan_scene_row *row = row_at(scene, index);
    return row ? row->structure : VK_NULL_HANDLE;
}

enum bvhd_status bvhd_vulkan_scene_storage(const struct bvhd_vulkan_scene *scene, uint32_t index,
                                           struct bvhd_vulkan_span *ret_span, VkDeviceSize *ret_buffer_size)
{
    const struct vulkan_scene_row *row = row_at(scene, index);
    if (!scene || !ret_span || !ret_buffer_size)
        return BVHD_INVALID;
    if (!row || scene->target != BVHD_TARGET_PORTABLE)
        return BVHD_NOT_FOUND;
    *ret_span = (struct bvhd_vulkan_span){scene->pages[0].buffer, row->offset, row->storage_size};
    *ret_buffer_size = scene->pages[0].size;
    return BVHD_OK;
}

uint64_t bvhd_vulkan_scene_location(const struct bvhd_vulkan_scene *scene, uint32_t index)
{
    const struct vulkan_scene_row *row = row_at(scene, index);
    return row ? row->location : VULKAN_SCENE_NOWHERE;
}
