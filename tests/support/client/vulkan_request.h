/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_request.h - a request as Vulkan's structs, made from the neutral description, for tests that give random
 * requests to calls of the client library. For test programs only.
 */
#ifndef BVHD_VULKAN_REQUEST_H
#define BVHD_VULKAN_REQUEST_H

#include <string.h>

#include <vulkan/vulkan_core.h>

#include "proto/base/geometry.h"

enum { VULKAN_REQUEST_GEOMETRIES = 8 };

struct vulkan_request {
    VkAccelerationStructureBuildGeometryInfoKHR info;
    VkAccelerationStructureGeometryKHR geometries[VULKAN_REQUEST_GEOMETRIES];
    VkAccelerationStructureBuildRangeInfoKHR ranges[VULKAN_REQUEST_GEOMETRIES];
    uint32_t counts[VULKAN_REQUEST_GEOMETRIES]; /* of primitives */
};

static inline VkAccelerationStructureGeometryDataKHR vulkan_request_data(const struct geometry *geometry)
{
    const struct geometry_triangles *triangles = &geometry->triangles;
    switch (geometry->type) {
    case GEOMETRY_TRIANGLES:
        return (VkAccelerationStructureGeometryDataKHR){
            .triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                          .vertexFormat = (VkFormat)triangles->vertex_format,
                          .vertexData.hostAddress = triangles->vertices.data,
                          .vertexStride = triangles->vertex_stride,
                          .maxVertex = triangles->max_vertex,
                          .indexType = (VkIndexType)triangles->index_type,
                          .indexData.hostAddress = triangles->indices.data,
                          .transformData.hostAddress = triangles->transform.data}};
    case GEOMETRY_AABBS:
        return (VkAccelerationStructureGeometryDataKHR){
            .aabbs = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
                      .data.hostAddress = geometry->aabbs.boxes.data,
                      .stride = geometry->aabbs.stride}};
    default:
        return (VkAccelerationStructureGeometryDataKHR){
            .instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                          .data.hostAddress = geometry->instances.records.data}};
    }
}

/* Describes a request of at most VULKAN_REQUEST_GEOMETRIES geometries. *ret_request must not be copied. */
static inline void vulkan_request_make(const struct build_input *input, struct vulkan_request *ret_request)
{
    memset(ret_request, 0, sizeof *ret_request);
    ret_request->info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = (VkAccelerationStructureTypeKHR)input->type,
        .flags = input->flags,
        .geometryCount = input->geometry_count,
        .pGeometries = ret_request->geometries};
    for (uint32_t i = 0; i < input->geometry_count; i++) {
        const struct geometry *geometry = &input->geometries[i];
        const struct geometry_range *range = &geometry->range;
        ret_request->geometries[i] =
            (VkAccelerationStructureGeometryKHR){.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                                                 .geometryType = (VkGeometryTypeKHR)geometry->type,
                                                 .geometry = vulkan_request_data(geometry),
                                                 .flags = geometry->flags};
        ret_request->ranges[i] = (VkAccelerationStructureBuildRangeInfoKHR){
            range->primitive_count, range->primitive_offset, range->first_vertex, range->transform_offset};
        ret_request->counts[i] = range->primitive_count;
    }
}

#endif
