/* SPDX-License-Identifier: Apache-2.0 */
#include <bvhd/bvhd_micromap.h>

#include "client/vulkan_input_kind.h"

enum { MOST_TEXELS = 16384 };

/* Sizes that break a rule say nothing about memory, and validate_input reports them. */
static uint64_t alpha_size(const struct bvhd_micromap_bake *bake)
{
    const bool is_valid = bake->width >= 1 && bake->width <= MOST_TEXELS && bake->height <= MOST_TEXELS &&
                          bake->row_stride >= bake->width;
    return is_valid ? vulkan_input_extent(0, bake->row_stride, bake->height, bake->width) : 0;
}

static uint64_t index_size(VkIndexType type)
{
    return type == VK_INDEX_TYPE_UINT16 ? 6 : type == VK_INDEX_TYPE_UINT32 ? 12 : 0;
}

/* Returns the bytes of the indices of all triangles. */
static struct bytes find_indices(const struct bvhd_micromap_bake *bake, const struct geometry_range *range)
{
    const uint64_t size = index_size(bake->index_type);
    if (size == 0 || !vulkan_input_is_countable(range))
        return (struct bytes){size > 0 ? bake->indices : NULL, 0};
    return vulkan_input_bytes(bake->indices, vulkan_input_extent(0, size, range->primitive_count, size));
}

static enum bvhd_status convert(const struct input_entry *entry, const void *data, struct geometry *geometry)
{
    const struct bvhd_micromap_bake *bake = data;
    (void)entry;
    geometry->range = (struct geometry_range){.primitive_count = bake->triangle_count};
    geometry->bake = (struct geometry_bake){
        .alpha = vulkan_input_bytes(bake->alpha, alpha_size(bake)),
        .width = bake->width,
        .height = bake->height,
        .row_stride = bake->row_stride,
        .wrap_u = (uint32_t)bake->wrap_u,
        .wrap_v = (uint32_t)bake->wrap_v,
        .is_nearest = bake->is_nearest,
        .mode = (uint32_t)bake->mode,
        .cutoff = bake->cutoff,
        .format = (uint32_t)bake->format,
        .level = bake->level,
        .coordinates = vulkan_input_bytes(
            bake->coordinates, vulkan_input_extent(0, bake->coordinate_stride, bake->vertex_count, 2 * sizeof(float))),
        .coordinate_stride = bake->coordinate_stride,
        .vertex_count = bake->vertex_count,
        .index_type = (uint32_t)bake->index_type,
        .indices = find_indices(bake, &geometry->range),
    };
    return BVHD_OK;
}

const struct vulkan_input_kind vulkan_input_baked_micromap = {
    .head = BVHD_STRUCTURE_TYPE_MICROMAP_BAKE,
    .is_chained = true,
    .type_rule = BVHD_VUID_11568,
    .convert = convert,
};
