/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "library.h"
#include "vulkan_blob.h"
#include "vulkan_buffer.h"
#include "vulkan_work.h"

/* A step fills and submits so much; a page holds so much, or one structure that is larger. */
enum { STEP_SIZE = 32 << 20, PAGE_SIZE = 64 << 20 };
static const uint64_t nowhere = UINT64_MAX;

/* `leader` is the lowest row with the same bytes: there they are loaded, and the row is a copy of it. */
struct scene_row {
    const void *data;
    uint64_t size;
    uint32_t row, leader;
    VkAccelerationStructureKHR structure;
    uint64_t location; /* as bvhd_vulkan_scene_location */
    uint32_t page;
    uint64_t offset, storage_size; /* in its page */
};

struct bvhd_vulkan_scene {
    const struct bvhd_vulkan_device *device;
    enum bvhd_target target;
    struct scene_row *rows;
    uint32_t row_count;
    struct vulkan_buffer *pages; /* portable: one */
    uint32_t page_count;
};

/* What creating needs and the scene does not keep. */
struct loading {
    struct bvhd_vulkan_device *device;
    const struct bvhd_vulkan_queue *queue;
    const struct bvhd_vulkan_scene_options *options;
    struct bvhd_vulkan_scene *scene;
    uint64_t *references; /* locations, by row; without a structure `nowhere` or, native, 0 */
    struct vulkan_work work;
    struct vulkan_buffer staging;
    uint64_t staged; /* bytes of the staging buffer that this step has filled */
    bool is_recording;
    struct bvhd_error *error;
};

static bool is_loaded(const struct scene_row *row)
{
    return row->data && row->leader == row->row;
}

static enum bvhd_status no_memory(const struct loading *loading)
{
    return bvhd_error_set(loading->error, BVHD_NO_MEMORY, "scene", "no memory for %" PRIu32 " structures",
                          loading->options->blob_count);
}

static enum bvhd_status row_error(const struct loading *loading, uint32_t row, const struct bvhd_error *inner)
{
    char where[BVHD_WHERE_SIZE];
    snprintf(where, sizeof where, "blobs[%" PRIu32 "]: %.80s", row, inner->where);
    return bvhd_error_set(loading->error, inner->status, where, "%s", inner->text);
}

/* ---- which structures there are ---- */

static int by_data(const void *a, const void *b)
{
    const struct scene_row *x = a, *y = b;
    if (x->data != y->data)
        return (uintptr_t)x->data < (uintptr_t)y->data ? -1 : 1;
    return x->row < y->row ? -1 : x->row > y->row;
}

static int by_row(const void *a, const void *b)
{
    const struct scene_row *x = a, *y = b;
    return x->row < y->row ? -1 : x->row > y->row;
}

static enum bvhd_status list_rows(struct loading *loading)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    uint32_t count = loading->options->blob_count;
    scene->rows = memory_array(&library_memory, count, sizeof *scene->rows);
    loading->references = memory_array(&library_memory, count, sizeof *loading->references);
    if (!scene->rows || !loading->references)
        return no_memory(loading);
    scene->row_count = count;
    for (uint32_t i = 0; i < count; i++) {
        const struct bvhd_vulkan_bytes *blob = &loading->options->blobs[i];
        scene->rows[i] = (struct scene_row){.data = blob->data, .size = blob->size, .row = i, .location = nowhere};
        loading->references[i] = nowhere;
    }
    qsort(scene->rows, count, sizeof *scene->rows, by_data);
    for (uint32_t i = 0; i < count; i++)
        scene->rows[i].leader =
            i > 0 && scene->rows[i].data == scene->rows[i - 1].data ? scene->rows[i - 1].leader : scene->rows[i].row;
    qsort(scene->rows, count, sizeof *scene->rows, by_row);
    for (uint32_t i = 0; i < count; i++)
        if (scene->rows[i].size != scene->rows[scene->rows[i].leader].size)
            return bvhd_error_set(loading->error, BVHD_INVALID, "blobs", "the same data with two sizes");
    return BVHD_OK;
}

/* A structure that the device takes, of the scene's target, a bottom level unless it is the last one. */
static enum bvhd_status check_row(struct loading *loading, const struct bvhd_format *format, struct scene_row *row)
{
    struct bvhd_error inner;
    struct bvhd_vulkan_requirements needed;
    struct bvhd_vulkan_scene *scene = loading->scene;
    enum bvhd_status status = bvhd_vulkan_check(loading->device, format, row->data, row->size, &inner);
    if (status == BVHD_OK)
        status = bvhd_vulkan_requirements(loading->device, row->data, row->size, &needed, &inner);
    if (status == BVHD_OK && scene->target && scene->target != needed.target)
        status = bvhd_error_set(&inner, BVHD_INVALID, "data", "of another target than those before");
    if (status == BVHD_OK && needed.type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR && row->row + 1 < scene->row_count)
        status = bvhd_error_set(&inner, BVHD_INVALID, "data", "a top level that is not the last one");
    if (status != BVHD_OK)
        return row_error(loading, row->row, &inner);
    scene->target = needed.target;
    row->storage_size = needed.storage_size;
    return BVHD_OK;
}

static enum bvhd_status check_rows(struct loading *loading, const struct bvhd_format *format)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    for (uint32_t i = 0; i < scene->row_count; i++) {
        enum bvhd_status status = is_loaded(&scene->rows[i]) ? check_row(loading, format, &scene->rows[i]) : BVHD_OK;
        if (status != BVHD_OK)
            return status;
    }
    if (!scene->rows[scene->row_count - 1].data)
        return bvhd_error_set(loading->error, BVHD_INVALID, "blobs", "the last one is the scene's own structure, and there is none");
    return BVHD_OK;
}

/* Whether a format has to be found: a structure is native, and the device takes such. */
static bool needs_probe(const struct loading *loading)
{
    if (loading->options->format || !loading->device->has_structures)
        return false;
    for (uint32_t i = 0; i < loading->scene->row_count; i++) {
        struct vulkan_blob blob;
        const struct scene_row *row = &loading->scene->rows[i];
        if (is_loaded(row) && vulkan_blob_read((struct bytes){row->data, row->size}, &blob, NULL) == BVHD_OK)
            return blob.target != BVHD_TARGET_PORTABLE;
    }
    return false;
}

static enum bvhd_status probe_device(const struct loading *loading, struct bvhd_format *ret_format)
{
    void *probe = NULL;
    uint64_t size = 0;
    enum bvhd_status status = bvhd_vulkan_probe(loading->device, loading->queue, &probe, &size, loading->error);
    if (status == BVHD_OK)
        status = bvhd_format_from_probe(probe, size, ret_format, loading->error);
    bvhd_vulkan_free(probe);
    return status;
}

/* ---- where they go ---- */

/*
 * Gives each structure a place: native ones share pages, portable ones are one page. Only the last page is open, so that two pages in a row hold more than
 * PAGE_SIZE together, and there are few of them.
 */
static enum bvhd_status place_rows(struct loading *loading, uint64_t alignment, uint64_t **ret_page_sizes)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    uint64_t *sizes = memory_array(&library_memory, scene->row_count, sizeof *sizes);
    if (!sizes)
        return no_memory(loading);
    uint32_t pages = 0;
    for (uint32_t i = 0; i < scene->row_count; i++) {
        struct scene_row *row = &scene->rows[i];
        if (!is_loaded(row))
            continue;
        uint64_t begin = pages > 0 ? bytes_align(sizes[pages - 1], alignment) : 0;
        if (pages == 0 || (scene->target != BVHD_TARGET_PORTABLE && begin + row->storage_size > PAGE_SIZE)) {
            pages++;
            begin = 0;
        }
        row->page = pages - 1;
        row->offset = begin;
        sizes[pages - 1] = begin + row->storage_size;
    }
    scene->page_count = pages;
    *ret_page_sizes = sizes;
    return BVHD_OK;
}

static enum bvhd_status create_pages(struct loading *loading, const uint64_t *sizes, VkBufferUsageFlags usage)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    bool is_bound = scene->target == BVHD_TARGET_PORTABLE && !(loading->options->flags & BVHD_VULKAN_SCENE_ADDRESSES);
    scene->pages = memory_array(&library_memory, scene->page_count, sizeof *scene->pages);
    if (!scene->pages)
        return no_memory(loading);
    memset(scene->pages, 0, scene->page_count * sizeof *scene->pages);
    for (uint32_t i = 0; i < scene->page_count; i++) {
        if (is_bound && sizes[i] > scene->device->limits.storage_range)
            return bvhd_error_set(loading->error, BVHD_TOO_LARGE, "scene",
                                  "%" PRIu64 " bytes, a shader sees %" PRIu64 " of a buffer: it takes BVHD_VULKAN_SCENE_ADDRESSES",
                                  sizes[i], scene->device->limits.storage_range);
        enum bvhd_status status = vulkan_buffer_create(scene->device, sizes[i], usage, VULKAN_DEVICE, &scene->pages[i], loading->error);
        if (status != BVHD_OK)
            return status;
    }
    return BVHD_OK;
}

/* The largest piece that is staged at once, at its aligned address. */
static enum bvhd_status create_staging(struct loading *loading, const struct bvhd_vulkan_requirements *needed)
{
    const struct bvhd_vulkan_scene *scene = loading->scene;
    bool is_native = scene->target != BVHD_TARGET_PORTABLE;
    uint64_t all = 0, largest = 0;
    for (uint32_t i = 0; i < scene->row_count; i++) {
        const struct scene_row *row = &scene->rows[i];
        if (!is_loaded(row))
            continue;
        all += bytes_align(row->size, needed->staging_alignment);
        largest = row->size > largest ? row->size : largest;
    }
    uint64_t size = all < STEP_SIZE ? all : STEP_SIZE;
    if (is_native && largest > size)
        size = largest;
    return vulkan_buffer_create(loading->device, size + needed->staging_alignment, needed->staging_usage, VULKAN_HOST,
                                &loading->staging, loading->error);
}

static enum bvhd_status place_all(struct loading *loading)
{
    struct bvhd_vulkan_requirements needed;
    struct bvhd_vulkan_scene *scene = loading->scene;
    const struct scene_row *last = &scene->rows[scene->row_count - 1];
    uint64_t *sizes = NULL;
    enum bvhd_status status = bvhd_vulkan_requirements(loading->device, last->data, last->size, &needed, loading->error);
    if (status == BVHD_OK)
        status = place_rows(loading, needed.storage_alignment, &sizes);
    if (status == BVHD_OK)
        status = create_pages(loading, sizes, needed.storage_usage | VK_BUFFER_USAGE_TRANSFER_SRC_BIT);
    if (status == BVHD_OK)
        status = create_staging(loading, &needed);
    memory_free(&library_memory, sizes);
    return status;
}

/* ---- upload ---- */

static enum bvhd_status submit_step(struct loading *loading)
{
    if (!loading->is_recording)
        return BVHD_OK;
    bvhd_vulkan_record_barrier(loading->device, loading->work.commands);
    loading->is_recording = false;
    loading->staged = 0;
    return vulkan_work_run(&loading->work, loading->error);
}

/*
 * Room for at least `least` bytes in the staging buffer, from *ret_offset on; *ret_size: how many there are. What was recorded is submitted first when there is none.
 */
static enum bvhd_status take_staging(struct loading *loading, uint64_t least, uint64_t alignment, uint64_t *ret_offset,
                                     uint64_t *ret_size)
{
    enum bvhd_status status = BVHD_OK;
    uint64_t address = loading->staging.address;
    uint64_t offset = bytes_align(address + loading->staged, alignment) - address;
    if (offset + least > loading->staging.size) {
        status = submit_step(loading);
        offset = bytes_align(address, alignment) - address;
    }
    if (status == BVHD_OK && !loading->is_recording) {
        status = vulkan_work_begin(&loading->work, loading->error);
        loading->is_recording = status == BVHD_OK;
    }
    *ret_offset = offset;
    *ret_size = loading->staging.size - offset;
    return status;
}

static enum bvhd_status load_native(struct loading *loading, struct scene_row *row)
{
    struct bvhd_error inner;
    uint64_t offset = 0, room = 0;
    enum bvhd_status status = take_staging(loading, row->size, 256, &offset, &room);
    if (status != BVHD_OK)
        return status;
    const struct bvhd_vulkan_upload upload = {
        .struct_size = sizeof upload,
        .data = row->data,
        .size = row->size,
        .staging = {loading->staging.buffer, offset, room},
        .staging_mapped = loading->staging.mapped + offset,
        .storage = {loading->scene->pages[row->page].buffer, row->offset, row->storage_size},
        .references = loading->references,
        .reference_count = loading->scene->row_count - 1,
    };
    status = bvhd_vulkan_record_upload(loading->device, loading->work.commands, &upload, &row->structure, &inner);
    if (status != BVHD_OK)
        return row_error(loading, row->row, &inner);
    loading->staged = offset + row->size;
    row->location = bvhd_vulkan_address(loading->device, row->structure);
    return BVHD_OK;
}

/* In as many steps as it takes. */
static enum bvhd_status load_portable(struct loading *loading, const struct scene_row *row)
{
    struct vulkan_blob blob;
    struct bvhd_error inner;
    const struct vulkan_buffer *page = &loading->scene->pages[row->page];
    enum bvhd_status status = vulkan_blob_read((struct bytes){row->data, row->size}, &blob, &inner);
    if (status == BVHD_OK)
        status = vulkan_blob_check_references(&blob, loading->references, loading->scene->row_count - 1, nowhere, &inner);
    for (uint64_t done = 0; status == BVHD_OK && done < blob.body.size;) {
        uint64_t offset = 0, room = 0, left = blob.body.size - done;
        if ((status = take_staging(loading, left < 64 ? left : 64, 64, &offset, &room)) != BVHD_OK)
            return status;
        uint64_t size = left < room ? left : room & ~UINT64_C(63);
        status = vulkan_blob_fill_portable(&blob, loading->references, done, done + size, loading->staging.mapped + offset, &inner);
        if (status == BVHD_OK) {
            const VkBufferCopy copy = {offset, row->offset + done, size};
            loading->device->vk.CmdCopyBuffer(loading->work.commands, loading->staging.buffer, page->buffer, 1, &copy);
        }
        loading->staged = offset + size;
        done += size;
    }
    return status == BVHD_OK ? BVHD_OK : row_error(loading, row->row, &inner);
}

/* Portable structures have their places before anything is loaded; native ones when they have been created, bottom levels first. */
static void locate_portable(struct loading *loading)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    for (uint32_t i = 0; i < scene->row_count; i++) {
        struct scene_row *row = &scene->rows[i];
        if (is_loaded(row))
            row->location = row->offset + (loading->options->flags & BVHD_VULKAN_SCENE_ADDRESSES ? scene->pages[0].address : 0);
    }
}

static enum bvhd_status load_all(struct loading *loading)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    bool is_portable = scene->target == BVHD_TARGET_PORTABLE;
    enum bvhd_status status = BVHD_OK;
    if (is_portable)
        locate_portable(loading);
    for (uint32_t i = 0; status == BVHD_OK && i < scene->row_count; i++) {
        struct scene_row *row = &scene->rows[i];
        const struct scene_row *leader = &scene->rows[row->leader];
        if (is_loaded(row))
            status = is_portable ? load_portable(loading, row) : load_native(loading, row);
        else if (row->data)
            *row = (struct scene_row){.data = row->data,
                                      .size = row->size,
                                      .row = row->row,
                                      .leader = row->leader,
                                      .structure = leader->structure,
                                      .location = leader->location,
                                      .page = leader->page,
                                      .offset = leader->offset,
                                      .storage_size = leader->storage_size};
        loading->references[i] = row->data || is_portable ? row->location : 0;
    }
    return status == BVHD_OK ? submit_step(loading) : status;
}

/* ---- the whole ---- */

static enum bvhd_status check_options(const struct bvhd_vulkan_device *device, const struct bvhd_vulkan_scene_options *options,
                                      struct bvhd_error *error)
{
    if (options->struct_size < sizeof *options)
        return bvhd_error_set(error, BVHD_INVALID, "options.struct_size", "%zu bytes, but %zu are needed", options->struct_size,
                              sizeof *options);
    if (options->blob_count == 0 || !options->blobs)
        return bvhd_error_set(error, BVHD_INVALID, "blobs", "there is no structure");
    if (options->flags & ~(uint32_t)BVHD_VULKAN_SCENE_ADDRESSES)
        return bvhd_error_set(error, BVHD_INVALID, "options.flags", "0x%" PRIx32 " is not known", options->flags);
    if ((options->flags & BVHD_VULKAN_SCENE_ADDRESSES) && !device->has_addresses)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "options.flags", "the device has no buffer addresses");
    return BVHD_OK;
}

static enum bvhd_status load(struct loading *loading)
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
    if (status == BVHD_OK)
        status = place_all(loading);
    if (status == BVHD_OK)
        status = vulkan_work_init(&loading->work, loading->device, loading->queue, loading->error);
    return status == BVHD_OK ? load_all(loading) : status;
}

enum bvhd_status bvhd_vulkan_scene_create(struct bvhd_vulkan_device *device, const struct bvhd_vulkan_queue *queue,
                                          const struct bvhd_vulkan_scene_options *options, struct bvhd_vulkan_scene **ret_scene,
                                          struct bvhd_error *ret_error)
{
    enum bvhd_status status = check_options(device, options, ret_error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_vulkan_scene *scene = memory_alloc(&library_memory, sizeof *scene);
    struct loading loading = {.device = device, .queue = queue, .options = options, .scene = scene, .error = ret_error};
    if (!scene)
        return no_memory(&loading);
    memset(scene, 0, sizeof *scene);
    scene->device = device;
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
        if (is_loaded(&scene->rows[i]) && scene->rows[i].structure)
            device->vk.DestroyAccelerationStructureKHR(device->handle, scene->rows[i].structure, device->allocator);
    for (uint32_t i = 0; scene->pages && i < scene->page_count; i++)
        vulkan_buffer_destroy(device, &scene->pages[i]);
    memory_free(&library_memory, scene->pages);
    memory_free(&library_memory, scene->rows);
    memory_free(&library_memory, scene);
}

static const struct scene_row *row_at(const struct bvhd_vulkan_scene *scene, uint32_t index)
{
    return index < scene->row_count && scene->rows[index].data ? &scene->rows[index] : NULL;
}

enum bvhd_target bvhd_vulkan_scene_target(const struct bvhd_vulkan_scene *scene)
{
    return scene->target;
}

VkAccelerationStructureKHR bvhd_vulkan_scene_structure(const struct bvhd_vulkan_scene *scene, uint32_t index)
{
    const struct scene_row *row = row_at(scene, index);
    return row ? row->structure : VK_NULL_HANDLE;
}

enum bvhd_status bvhd_vulkan_scene_storage(const struct bvhd_vulkan_scene *scene, uint32_t index, struct bvhd_vulkan_span *ret_span,
                                           VkDeviceSize *ret_buffer_size)
{
    const struct scene_row *row = row_at(scene, index);
    if (!row || scene->target != BVHD_TARGET_PORTABLE)
        return BVHD_NOT_FOUND;
    *ret_span = (struct bvhd_vulkan_span){scene->pages[0].buffer, row->offset, row->storage_size};
    *ret_buffer_size = scene->pages[0].size;
    return BVHD_OK;
}

uint64_t bvhd_vulkan_scene_location(const struct bvhd_vulkan_scene *scene, uint32_t index)
{
    const struct scene_row *row = row_at(scene, index);
    return row ? row->location : nowhere;
}
