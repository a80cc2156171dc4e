/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer_scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* "blobs[2]: header.driverUUID" is "park.blas-tree-7ab31c90e2d4f586.as: header.driverUUID" to people. */
static void name_file(const struct structures *structures, struct bvhd_error *error)
{
    static const char list[] = "blobs[";
    char where[sizeof error->where];
    char *end;
    if (strncmp(error->where, list, sizeof list - 1))
        return;
    unsigned long row = strtoul(error->where + sizeof list - 1, &end, 10);
    if (*end != ']' || row >= structures->file_count || !*structures->files[row].name)
        return;
    end++;
    snprintf(where, sizeof where, "%s%.55s", structures->files[row].name, end);
    memcpy(error->where, where, sizeof where);
}

enum bvhd_status tracer_scene_create(struct gpu *gpu, const struct structures *structures, uint32_t flags,
                                     struct memory *memory, struct bvhd_vulkan_scene **ret_scene,
                                     struct bvhd_error *error)
{
    struct bvhd_error inner = {0};
    struct bvhd_vulkan_bytes *blobs = memory_array(memory, structures->file_count, sizeof *blobs);
    if (!blobs)
        return bvhd_error_no_memory(error, structures->name, "no memory for the list of structures");
    for (uint32_t i = 0; i < structures->file_count; i++)
        blobs[i] = (struct bvhd_vulkan_bytes){structures->blobs[i].data, structures->blobs[i].size};
    const struct bvhd_vulkan_scene_options options = {
        .struct_size = sizeof options, .blobs = blobs, .blob_count = structures->file_count, .flags = flags};
    enum bvhd_status status = bvhd_vulkan_scene_create(gpu->library, &gpu->queue, &options, ret_scene, &inner);
    memory_free(memory, blobs);
    if (status != BVHD_OK) {
        name_file(structures, &inner);
        if (error)
            *error = inner;
    }
    return status;
}
