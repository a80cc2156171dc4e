/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_micromap.h"
#include "proto/base/vertex_element.h"

static uint64_t element_size(uint32_t format)
{
    const struct vertex_element *element = vertex_element_find(format);
    return element ? element->size : 0;
}

/*
 * With indices, any vertex up to maxVertex may be used, and the array begins at vertex 0; without indices the range
 * says what is read.
 */
static uint64_t vertex_bytes(const VkAccelerationStructureGeometryTrianglesDataKHR *triangles,
                             const struct geometry_range *range)
{
    uint64_t size = element_size((uint32_t)triangles->vertexFormat);
    if (range->primitive_count == 0 || !vulkan_input_is_countable(range))
        return 0;
    if (triangles->indexType != VK_INDEX_TYPE_NONE_KHR)
        return vulkan_input_extent(0, triangles->vertexStride, (uint64_t)triangles->maxVertex + 1, size);
    return vulkan_input_extent(range->primitive_offset, triangles->vertexStride,
                               (uint64_t)range->first_vertex + (uint64_t)3 * range->primitive_count, size);
}

/* For an unknown index type the size of three indices is unknown: nothing is read, and validate_input reports it. */
static uint64_t index_bytes(const VkAccelerationStructureGeometryTrianglesDataKHR *triangles,
                            const struct geometry_range *range)
{
    const VkIndexType type = triangles->indexType;
    const uint64_t size = type == VK_INDEX_TYPE_UINT16 ? 6 : type == VK_INDEX_TYPE_UINT32 ? 12 : 0;
    if (size == 0 || !vulkan_input_is_countable(range))
        return 0;
    return vulkan_input_extent(range->primitive_offset, size, range->primitive_count, size);
}

static enum bvhd_status convert(const struct input_entry *entry, const void *data, struct geometry *geometry)
{
    const VkAccelerationStructureGeometryTrianglesDataKHR *triangles = data;
    const struct geometry_range *range = &geometry->range;
    bool indexed = triangles->indexType != VK_INDEX_TYPE_NONE_KHR;
    geometry->triangles = (struct geometry_triangles){
        .vertex_format = (uint32_t)triangles->vertexFormat,
        .max_vertex = triangles->maxVertex,
        .vertex_stride = triangles->vertexStride,
        .index_type = (uint32_t)triangles->indexType,
        .vertices = vulkan_input_bytes(triangles->vertexData.hostAddress, vertex_bytes(triangles, range)),
        .indices = vulkan_input_bytes(indexed ? triangles->indexData.hostAddress : NULL, index_bytes(triangles, range)),
        .transform =
            vulkan_input_bytes(triangles->transformData.hostAddress,
                               vulkan_input_extent(range->transform_offset, 0, 1, sizeof(VkTransformMatrixKHR))),
    };
    return vulkan_input_attach(entry, triangles, geometry);
}

const struct vulkan_input_kind vulkan_input_triangles = {
    .head = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
    .type_rule = BVHD_VUID_TrianglesData_sType_sType,
    .chain_rule = BVHD_VUID_TrianglesData_pNext_pNext,
    .end = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MOTION_TRIANGLES_DATA_NV,
    .has_micromaps = true,
    .unique_rule = BVHD_VUID_TrianglesData_sType_unique,
    .convert = convert,
};
