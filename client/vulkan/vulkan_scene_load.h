/* SPDX-License-Identifier: Apache-2.0 */
/* vulkan_scene_load.h - the internal state of a scene, and how its structures are loaded to the device. */
#ifndef BVHD_VULKAN_SCENE_LOAD_H
#define BVHD_VULKAN_SCENE_LOAD_H

#include "client/vulkan/vulkan_blob.h"
#include "client/vulkan/vulkan_buffer.h"
#include "client/vulkan/vulkan_contents.h"
#include "client/vulkan/vulkan_work.h"

#define VULKAN_SCENE_NOWHERE UINT64_MAX

/*
 * One blob of the scene. `leader` is the lowest row with the same `data` pointer. Only the leader is loaded; the other
 * rows with that pointer use its structure.
 */
struct vulkan_scene_row {
    const void *data;
    uint64_t size;
    uint32_t row, leader;
    VkAccelerationStructureKHR structure;
    uint64_t location; /* as bvhd_vulkan_scene_location returns it */
    uint32_t page;
    uint64_t offset, storage_size; /* bytes, in its page */
    bool is_top;
};

/* A scene on the device. */
struct bvhd_vulkan_scene {
    const struct bvhd_vulkan_device *device;
    enum bvhd_target target;
    struct vulkan_scene_row *rows;
    uint32_t row_count;
    struct vulkan_buffer *pages; /* the buffers that hold all structures; portable: one page */
    uint32_t page_count;
    uint32_t flags; /* BVHD_VULKAN_SCENE_ */
    struct vulkan_contents contents; /* portable */
};

/* The state that is needed only while a scene is created. */
struct vulkan_scene_loading {
    struct bvhd_vulkan_device *device;
    const struct bvhd_vulkan_queue *queue;
    const struct bvhd_vulkan_scene_options *options;
    struct bvhd_vulkan_scene *scene;
    uint64_t *references; /* locations, by row; without a structure VULKAN_SCENE_NOWHERE (portable) or 0 (native) */
    struct vulkan_work work;
    struct vulkan_buffer staging;
    uint64_t staged; /* bytes of the staging buffer that this step has filled */
    bool is_recording;
    struct bvhd_error *error;
};

/* Returns whether a row has its own bytes on the device. */
static inline bool vulkan_scene_row_is_loaded(const struct vulkan_scene_row *row)
{
    return row->data && row->leader == row->row;
}

/* Reports an error of one row, with the place "blobs[3]: ...". */
enum bvhd_status vulkan_scene_row_error(const struct vulkan_scene_loading *loading, uint32_t row,
                                        const struct bvhd_error *inner);
enum bvhd_status vulkan_scene_no_memory(const struct vulkan_scene_loading *loading);

/*
 * Allocates memory for the rows, which have been checked, and uploads them. Also on failure the scene and `loading`
 * keep what has been created; their owners free it.
 */
enum bvhd_status vulkan_scene_load(struct vulkan_scene_loading *loading);

#endif
