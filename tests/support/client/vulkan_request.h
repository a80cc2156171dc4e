/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_request.h - a request as Vulkan's structs, made from the neutral description, for tests that give random
 * requests to calls of the client library. For test programs only.
 */
#ifndef BVHD_VULKAN_REQUEST_H
#define BVHD_VULKAN_REQUEST_H

#include <string.h>

#include <bvhd/vulkan_nv.h>

#include "proto/base/kind.h"

enum { VULKAN_REQUEST_GEOMETRIES = 8 };

/* What the pNext chain of a geometry has. */
union vulkan_request_chain {
    VkAccelerationStructureGeometrySpheresDataNV spheres;
    VkAccelerationStructureGeometryLinearSweptSpheresDataNV swept_spheres;
};

struct vulkan_request {
    VkAccelerationStructureBuildGeometryInfoKHR info;
    VkAccelerationStructureGeometryKHR geometries[VULKAN_REQUEST_GEOMETRIES];
    VkAccelerationStructureBuildRangeInfoKHR ranges[VULKAN_REQUEST_GEOMETRIES];
    uint32_t counts[VULKAN_REQUEST_GEOMETRIES]; /* of primitives */
    union vulkan_request_chain chains[VULKAN_REQUEST_GEOMETRIES];
    VkAccelerationStructureGeometryMotionTrianglesDataNV ends[VULKAN_REQUEST_GEOMETRIES];
};

/* Fills in the struct of a round geometry, and returns it; NULL: the geometry is not round. */
static inline const void *vulkan_request_chain(const struct geometry *geometry, union vulkan_request_chain *ret_chain)
{
    const struct geometry_spheres *spheres = &geometry->spheres;
    if (geometry->type == GEOMETRY_SWEPT_SPHERES)
        spheres = &geometry->swept_spheres.ends;
    else if (geometry->type != GEOMETRY_SPHERES)
        return NULL;
    const VkAccelerationStructureGeometrySpheresDataNV data = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_SPHERES_DATA_NV,
        .vertexFormat = (VkFormat)spheres->vertex_format,
        .vertexData.hostAddress = spheres->vertices.data,
        .vertexStride = spheres->vertex_stride,
        .radiusFormat = (VkFormat)spheres->radius_format,
        .radiusData.hostAddress = spheres->radii.data,
        .radiusStride = spheres->radius_stride,
        .indexType = (VkIndexType)spheres->index_type,
        .indexData.hostAddress = spheres->indices.data,
        .indexStride = spheres->index_stride};
    if (geometry->type == GEOMETRY_SPHERES)
        ret_chain->spheres = data;
    else
        ret_chain->swept_spheres = (VkAccelerationStructureGeometryLinearSweptSpheresDataNV){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV,
            .vertexFormat = data.vertexFormat,
            .vertexData = data.vertexData,
            .vertexStride = data.vertexStride,
            .radiusFormat = data.radiusFormat,
            .radiusData = data.radiusData,
            .radiusStride = data.radiusStride,
            .indexType = data.indexType,
            .indexData = data.indexData,
            .indexStride = data.indexStride,
            .indexingMode = (VkRayTracingLssIndexingModeNV)geometry->swept_spheres.indexing_mode,
            .endCapsMode = (VkRayTracingLssPrimitiveEndCapsModeNV)geometry->swept_spheres.end_caps_mode};
    return ret_chain;
}

static inline VkAccelerationStructureGeometryDataKHR vulkan_request_data(const struct geometry *geometry)
{
    const struct geometry_triangles *triangles = &geometry->triangles;
    const VkAccelerationStructureGeometryDataKHR nothing = {.triangles.sType = VK_STRUCTURE_TYPE_MAX_ENUM};
    switch (geometry->type) {
    case GEOMETRY_TRIANGLES:
    case GEOMETRY_MOVING_TRIANGLES:
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
    case GEOMETRY_SPHERES:
    case GEOMETRY_SWEPT_SPHERES:
        return nothing; /* of their kinds nothing is in the union, which is not read */
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
        ret_request->geometries[i] = (VkAccelerationStructureGeometryKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            .pNext = vulkan_request_chain(geometry, &ret_request->chains[i]),
            .geometryType = (VkGeometryTypeKHR)kind_find(geometry->type)->vulkan_type,
            .geometry = vulkan_request_data(geometry),
            .flags = geometry->flags};
        if (geometry->type == GEOMETRY_MOVING_TRIANGLES) {
            ret_request->ends[i] = (VkAccelerationStructureGeometryMotionTrianglesDataNV){
                .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MOTION_TRIANGLES_DATA_NV,
                .vertexData.hostAddress = geometry->triangles.end_vertices.data};
            ret_request->geometries[i].geometry.triangles.pNext = &ret_request->ends[i];
        }
        ret_request->ranges[i] = (VkAccelerationStructureBuildRangeInfoKHR){
            range->primitive_count, range->primitive_offset, range->first_vertex, range->transform_offset};
        ret_request->counts[i] = range->primitive_count;
    }
}

#endif
