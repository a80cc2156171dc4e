/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan/vulkan_scene_load.h"

#include <inttypes.h>
#include <stdio.h>

#include "client/library.h"

/* Bytes that one step stages and submits; bytes of a page, which can also be one larger structure. */
enum { SCENE_STEP = 32 << 20, SCENE_PAGE = 64 << 20 };

enum bvhd_status vulkan_scene_no_memory(const struct vulkan_scene_loading *loading)
{
    return bvhd_error_no_memory(loading->error, "scene", "no memory for %" PRIu32 " structures",
                                loading->options->blob_count);
}

enum bvhd_status vulkan_scene_row_error(const struct vulkan_scene_loading *loading, uint32_t row,
                                        const struct bvhd_error *inner)
{
    char where[BVHD_WHERE_SIZE];
    snprintf(where, sizeof where, "blobs[%" PRIu32 "]: %.80s", row, inner->where);
    return bvhd_error_set(loading->error, inner->status, where, "%s", inner->text);
}

/* ---- Places ---- */

/*
 * Assigns a place to each structure: native ones share pages, portable ones form one page. Only the last page takes
 * structures, so that two consecutive pages together hold more than SCENE_PAGE, and there are few pages.
 */
static enum bvhd_status place_rows(struct vulkan_scene_loading *loading, uint64_t alignment, uint64_t **ret_page_sizes)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    uint64_t *sizes = memory_array(&library_memory, scene->row_count, sizeof *sizes);
    if (!sizes)
        return vulkan_scene_no_memory(loading);
    uint32_t pages = 0;
    for (uint32_t i = 0; i < scene->row_count; i++) {
        struct vulkan_scene_row *row = &scene->rows[i];
        if (!vulkan_scene_row_is_loaded(row))
            continue;
        uint64_t begin = pages > 0 ? bytes_align(sizes[pages - 1], alignment) : 0;
        if (pages == 0 || (scene->target != BVHD_TARGET_PORTABLE && begin + row->storage_size > SCENE_PAGE)) {
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

static enum bvhd_status create_pages(struct vulkan_scene_loading *loading, const uint64_t *sizes,
                                     VkBufferUsageFlags usage)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    bool is_bound = scene->target == BVHD_TARGET_PORTABLE && !(loading->options->flags & BVHD_VULKAN_SCENE_ADDRESSES);
    scene->pages = memory_array(&library_memory, scene->page_count, sizeof *scene->pages);
    if (!scene->pages)
        return vulkan_scene_no_memory(loading);
    memset(scene->pages, 0, scene->page_count * sizeof *scene->pages);
    for (uint32_t i = 0; i < scene->page_count; i++) {
        if (is_bound && sizes[i] > scene->device->limits.storage_range)
            return bvhd_error_set(loading->error, BVHD_TOO_LARGE, "scene",
                                  "%" PRIu64 " bytes, a shader sees %" PRIu64
                                  " of a buffer: it takes BVHD_VULKAN_SCENE_ADDRESSES",
                                  sizes[i], scene->device->limits.storage_range);
        enum bvhd_status status =
            vulkan_buffer_create(scene->device, sizes[i], usage, VULKAN_DEVICE, &scene->pages[i], loading->error);
        if (status != BVHD_OK)
            return status;
    }
    return BVHD_OK;
}

/* Creates the staging buffer, large enough for the largest piece that is staged at once, at an aligned address. */
static enum bvhd_status create_staging(struct vulkan_scene_loading *loading,
                                       const struct bvhd_vulkan_requirements *needed)
{
    const struct bvhd_vulkan_scene *scene = loading->scene;
    bool is_native = scene->target != BVHD_TARGET_PORTABLE;
    uint64_t all = 0, largest = 0;
    for (uint32_t i = 0; i < scene->row_count; i++) {
        const struct vulkan_scene_row *row = &scene->rows[i];
        if (!vulkan_scene_row_is_loaded(row))
            continue;
        all += bytes_align(row->size, needed->staging_alignment);
        largest = row->size > largest ? row->size : largest;
    }
    uint64_t size = all < SCENE_STEP ? all : SCENE_STEP;
    if (is_native && largest > size)
        size = largest;
    return vulkan_buffer_create(loading->device, size + needed->staging_alignment, needed->staging_usage, VULKAN_HOST,
                                &loading->staging, loading->error);
}

static enum bvhd_status place_all(struct vulkan_scene_loading *loading)
{
    struct bvhd_vulkan_requirements needed;
    struct bvhd_vulkan_scene *scene = loading->scene;
    const struct vulkan_scene_row *last = &scene->rows[scene->row_count - 1];
    uint64_t *sizes = NULL;
    enum bvhd_status status =
        bvhd_vulkan_requirements(loading->device, last->data, last->size, &needed, loading->error);
    if (status == BVHD_OK)
        status = place_rows(loading, needed.storage_alignment, &sizes);
    if (status == BVHD_OK)
        status = create_pages(loading, sizes, needed.storage_usage | VK_BUFFER_USAGE_TRANSFER_SRC_BIT);
    if (status == BVHD_OK)
        status = create_staging(loading, &needed);
    memory_free(&library_memory, sizes);
    return status;
}

/* ---- Upload ---- */

static enum bvhd_status submit_step(struct vulkan_scene_loading *loading)
{
    if (!loading->is_recording)
        return BVHD_OK;
    bvhd_vulkan_record_barrier(loading->device, loading->work.commands);
    loading->is_recording = false;
    loading->staged = 0;
    return vulkan_work_run(&loading->work, loading->error);
}

/*
 * Reserves at least `least` bytes of the staging buffer at *ret_offset; *ret_size is how many are available. If there
 * are too few, it first submits what has been recorded.
 */
static enum bvhd_status take_staging(struct vulkan_scene_loading *loading, uint64_t least, uint64_t alignment,
                                     uint64_t *ret_offset, uint64_t *ret_size)
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

static enum bvhd_status load_native(struct vulkan_scene_loading *loading, struct vulkan_scene_row *row)
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
        return vulkan_scene_row_error(loading, row->row, &inner);
    loading->staged = offset + row->size;
    row->location = bvhd_vulkan_address(loading->device, row->structure);
    return BVHD_OK;
}

/* Uploads a portable structure in as many steps as necessary. */
static enum bvhd_status load_portable(struct vulkan_scene_loading *loading, const struct vulkan_scene_row *row)
{
    struct vulkan_blob blob;
    struct bvhd_error inner;
    const struct vulkan_buffer *page = &loading->scene->pages[row->page];
    enum bvhd_status status = vulkan_blob_read((struct bytes){row->data, row->size}, &blob, &inner);
    if (status == BVHD_OK)
        status = vulkan_blob_check_references(&blob, loading->references, loading->scene->row_count - 1,
                                              VULKAN_SCENE_NOWHERE, &inner);
    for (uint64_t done = 0; status == BVHD_OK && done < blob.body.size;) {
        uint64_t offset = 0, room = 0, left = blob.body.size - done;
        if ((status = take_staging(loading, left < 64 ? left : 64, 64, &offset, &room)) != BVHD_OK)
            return status;
        uint64_t size = left < room ? left : room & ~UINT64_C(63);
        status = vulkan_blob_fill_portable(&blob, loading->references, done, done + size,
                                           loading->staging.mapped + offset, &inner);
        if (status == BVHD_OK) {
            const VkBufferCopy copy = {offset, row->offset + done, size};
            loading->device->vk.CmdCopyBuffer(loading->work.commands, loading->staging.buffer, page->buffer, 1, &copy);
        }
        loading->staged = offset + size;
        done += size;
    }
    return status == BVHD_OK ? BVHD_OK : vulkan_scene_row_error(loading, row->row, &inner);
}

/*
 * Portable structures have their locations before anything is loaded; native ones get theirs when they are created,
 * bottom levels first.
 */
static void locate_portable(struct vulkan_scene_loading *loading)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    for (uint32_t i = 0; i < scene->row_count; i++) {
        struct vulkan_scene_row *row = &scene->rows[i];
        if (vulkan_scene_row_is_loaded(row))
            row->location =
                row->offset + (loading->options->flags & BVHD_VULKAN_SCENE_ADDRESSES ? scene->pages[0].address : 0);
    }
}

static enum bvhd_status load_all(struct vulkan_scene_loading *loading)
{
    struct bvhd_vulkan_scene *scene = loading->scene;
    bool is_portable = scene->target == BVHD_TARGET_PORTABLE;
    enum bvhd_status status = BVHD_OK;
    if (is_portable)
        locate_portable(loading);
    for (uint32_t i = 0; status == BVHD_OK && i < scene->row_count; i++) {
        struct vulkan_scene_row *row = &scene->rows[i];
        const struct vulkan_scene_row *leader = &scene->rows[row->leader];
        if (vulkan_scene_row_is_loaded(row))
            status = is_portable ? load_portable(loading, row) : load_native(loading, row);
        else if (row->data)
            *row = (struct vulkan_scene_row){.data = row->data,
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

enum bvhd_status vulkan_scene_load(struct vulkan_scene_loading *loading)
{
    enum bvhd_status status = place_all(loading);
    if (status == BVHD_OK)
        status = vulkan_work_init(&loading->work, loading->device, loading->queue, loading->error);
    return status == BVHD_OK ? load_all(loading) : status;
}
