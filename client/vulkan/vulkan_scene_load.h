/* SPDX-License-Identifier: Apache-2.0 */
/* vulkan_scene_load.h - the insides of a scene, and how its structures get to the device. */
#ifndef BVHD_VULKAN_SCENE_LOAD_H
#define BVHD_VULKAN_SCENE_LOAD_H

#include "client/vulkan/vulkan_blob.h"
#include "client/vulkan/vulkan_buffer.h"
#include "client/vulkan/vulkan_work.h"

#define VULKAN_SCENE_NOWHERE UINT64_MAX

/* `leader` is the lowest row with the same bytes: there they are loaded, and the row is a copy of it. */
struct vulkan_scene_row {
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
    struct vulkan_scene_row *rows;
    uint32_t row_count;
    struct vulkan_buffer *pages; /* portable: one */
    uint32_t page_count;
};

/* What creating needs and the scene does not keep. */
struct vulkan_scene_loading {
    struct bvhd_vulkan_device *device;
    const struct bvhd_vulkan_queue *queue;
    const struct bvhd_vulkan_scene_options *options;
    struct bvhd_vulkan_scene *scene;
    uint64_t *references; /* locations, by row; without a structure VULKAN_SCENE_NOWHERE or, native, 0 */
    struct vulkan_work work;
    struct vulkan_buffer staging;
    uint64_t staged; /* bytes of the staging buffer that this step has filled */
    bool is_recording;
    struct bvhd_error *error;
};

/* Whether a row has bytes of its own on the device. */
static inline bool vulkan_scene_row_is_loaded(const struct vulkan_scene_row *row)
{
    return row->data && row->leader == row->row;
}

/* Tells an error of one row, "blobs[3]: ...". */
enum bvhd_status vulkan_scene_row_error(const struct vulkan_scene_loading *loading, uint32_t row,
                                        const struct bvhd_error *inner);
enum bvhd_status vulkan_scene_no_memory(const struct vulkan_scene_loading *loading);

/*
 * Places the rows, which have been checked, in memory that it allocates, and uploads them. Whatever happens, what the
 * scene and `loading` hold afterwards is for their owners to end.
 */
enum bvhd_status vulkan_scene_load(struct vulkan_scene_loading *loading);

#endif
