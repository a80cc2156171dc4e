/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan_input_kind.h"

/* The vertices at t = 1 take as many bytes as those at t = 0: both have one format and one stride. */
static enum bvhd_status convert(const struct input_entry *entry, const void *data, struct geometry *geometry)
{
    const VkAccelerationStructureGeometryTrianglesDataKHR *triangles = data;
    const VkAccelerationStructureGeometryMotionTrianglesDataNV *end =
        (const void *)vulkan_input_find(triangles, vulkan_input_triangles.end);
    enum bvhd_status status = vulkan_input_triangles.convert(entry, data, geometry);
    geometry->triangles.end_vertices =
        vulkan_input_bytes(end->vertexData.hostAddress, geometry->triangles.vertices.size);
    return status;
}

const struct vulkan_input_kind vulkan_input_moving_triangles = {
    .head = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
    .type_rule = BVHD_VUID_TrianglesData_sType_sType,
    .chain_rule = BVHD_VUID_TrianglesData_pNext_pNext,
    .convert = convert,
};
