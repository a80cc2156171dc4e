/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/micro_triangle.h"
#include "client/vulkan_input_micromap.h"

enum { STRIDE_ALIGNMENT = 4 };
_Static_assert(sizeof(VkAccelerationStructureGeometryMicromapDataKHR) == 64 &&
                   sizeof(VkMicromapTriangleKHR) == sizeof(struct micromap_triangle),
               "Vulkan's structs");

/* An address of the host, which this extension has as a number. */
static const void *host_address(VkDeviceAddress address)
{
    return (const void *)(uintptr_t)address;
}

/* Returns the sum of all counts; one that does not fit is as good as the largest number, which no limit allows. */
static uint32_t count_triangles(struct bytes usages)
{
    uint64_t count = 0;
    for (uint64_t at = 0; at < usages.size && count <= UINT32_MAX; at += sizeof(struct micromap_usage))
        count += bytes_get32(usages.data + at);
    return count <= UINT32_MAX ? (uint32_t)count : UINT32_MAX;
}

/* A stride that breaks Vulkan's rules says nothing about memory, and validate_input reports it. */
static struct bytes find_triangles(const VkAccelerationStructureGeometryMicromapDataKHR *data,
                                   const struct geometry_range *range)
{
    const uint64_t stride = data->triangleArrayStride, size = sizeof(struct micromap_triangle);
    const bool is_valid = stride >= size && stride % STRIDE_ALIGNMENT == 0 && vulkan_input_is_countable(range);
    return vulkan_input_bytes(host_address(data->triangleArray),
                              is_valid ? vulkan_input_extent(0, stride, range->primitive_count, size) : 0);
}

/* Returns where the states of a triangle end; 0 for one that no micromap may have. */
static uint64_t end_of_states(const unsigned char *bytes)
{
    struct micromap_triangle triangle;
    memcpy(&triangle, bytes, sizeof triangle);
    const bool has_states =
        (triangle.format == MICRO_2_STATE || triangle.format == MICRO_4_STATE) && triangle.level <= MICRO_LEVEL_MAX;
    return has_states
               ? (uint64_t)triangle.offset + micro_triangle_bytes((enum micro_format)triangle.format, triangle.level)
               : 0;
}

/*
 * Returns the bytes up to the end of the last states that a triangle has. Triangles that change meanwhile do no harm:
 * prepare reads them again, and refuses those whose states are not there.
 */
static uint64_t states_size(struct bytes triangles, uint64_t stride, uint32_t count)
{
    uint64_t size = 0;
    for (uint32_t i = 0; triangles.size > 0 && i < count; i++) {
        const uint64_t end = end_of_states(triangles.data + i * stride);
        size = end > size ? end : size;
    }
    return size;
}

static enum bvhd_status convert(const struct input_entry *entry, const void *struct_, struct geometry *geometry)
{
    const VkAccelerationStructureGeometryMicromapDataKHR *data = struct_;
    const struct usage_source source = {
        .count = data->usageCountsCount,
        .array = data->pUsageCounts,
        .pointers = (const void *const *)data->ppUsageCounts,
        .member = "micromap",
        .both_rule = BVHD_VUID_11642,
        .pointer_rule = BVHD_VUID_GeometryMicromapData_ppUsageCounts_parameter,
    };
    struct geometry_micromap micromap = {.stride = data->triangleArrayStride};
    enum bvhd_status status = vulkan_input_copy_usages(entry, geometry, &source, &micromap.usages);
    if (status != BVHD_OK)
        return status;
    geometry->range = (struct geometry_range){.primitive_count = count_triangles(micromap.usages)};
    micromap.triangles = find_triangles(data, &geometry->range);
    micromap.states = vulkan_input_bytes(
        host_address(data->data), states_size(micromap.triangles, micromap.stride, geometry->range.primitive_count));
    geometry->micromap = micromap;
    return BVHD_OK;
}

const struct vulkan_input_kind vulkan_input_micromap = {
    .head = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MICROMAP_DATA_KHR,
    .is_chained = true,
    .type_rule = BVHD_VUID_11568,
    .convert = convert,
};
