/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_round.h"
#include "proto/base/vertex_element.h"

static uint64_t vertex_size(uint32_t format)
{
    const struct vertex_element *element = vertex_element_find(format);
    return element ? element->size : 0;
}

static uint64_t radius_size(uint32_t format)
{
    const struct vertex_element *element = radius_element_find(format);
    return element ? element->size : 0;
}

/* Returns 0 for a type that spheres cannot have. */
static uint64_t index_size(VkIndexType type)
{
    return type == VK_INDEX_TYPE_UINT16 ? 2 : type == VK_INDEX_TYPE_UINT32 ? 4 : 0;
}

static struct bytes find_indices(const VkAccelerationStructureGeometrySpheresDataNV *source,
                                 const struct geometry_range *range, uint64_t count)
{
    uint64_t size = index_size(source->indexType);
    return vulkan_input_bytes(
        source->indexData.hostAddress,
        size > 0 ? vulkan_input_index_extent(range->primitive_offset, source->indexStride, count, size) : 0);
}

static uint32_t greatest_index(const unsigned char *indices, uint64_t stride, uint64_t count, uint64_t size)
{
    uint32_t greatest = 0;
    if (stride == 0)
        count = 1;
    for (uint64_t i = 0; i < count; i++) {
        const unsigned char *index = indices + i * stride;
        const uint32_t value = size == 2 ? bytes_get16(index) : bytes_get32(index);
        greatest = value > greatest ? value : greatest;
    }
    return greatest;
}

/* Returns how many vertices there are up to the last one in use; 0 if none is or if it cannot be known. */
static uint64_t used_vertices(const VkAccelerationStructureGeometrySpheresDataNV *source,
                              const struct geometry_range *range, struct bytes indices, const struct round_use *use)
{
    const uint64_t first = range->first_vertex, primitives = range->primitive_count;
    if (source->indexType == VK_INDEX_TYPE_NONE_KHR)
        return use->vertices * primitives > 0 ? first + use->vertices * primitives : 0;
    if (indices.size == 0)
        return 0;
    return first +
           greatest_index(indices.data + range->primitive_offset, source->indexStride, use->indices * primitives,
                          index_size(source->indexType)) +
           use->following + 1;
}

/* Returns the bytes of an array of vertices or radii. Without indices the primitive offset counts in them. */
static struct bytes find_elements(const void *address, uint64_t offset, uint64_t stride, uint64_t count, uint64_t size)
{
    return vulkan_input_bytes(address, size > 0 ? vulkan_input_extent(offset, stride, count, size) : 0);
}

struct geometry_spheres vulkan_input_round(const VkAccelerationStructureGeometrySpheresDataNV *source,
                                           const struct geometry_range *range, const struct round_use *use)
{
    struct geometry_spheres spheres = {
        .vertex_format = (uint32_t)source->vertexFormat,
        .radius_format = (uint32_t)source->radiusFormat,
        .index_type = (uint32_t)source->indexType,
        .vertex_stride = source->vertexStride,
        .radius_stride = source->radiusStride,
        .index_stride = source->indexStride,
    };
    if (!vulkan_input_is_countable(range))
        return spheres;
    spheres.indices = find_indices(source, range, (uint64_t)use->indices * range->primitive_count);
    const uint64_t vertices = used_vertices(source, range, spheres.indices, use);
    const uint64_t offset = source->indexType == VK_INDEX_TYPE_NONE_KHR ? range->primitive_offset : 0;
    spheres.vertices = find_elements(source->vertexData.hostAddress, offset, source->vertexStride, vertices,
                                     vertex_size(spheres.vertex_format));
    spheres.radii = find_elements(source->radiusData.hostAddress, offset, source->radiusStride, vertices,
                                  radius_size(spheres.radius_format));
    return spheres;
}
