/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_nv.h - Vulkan's structs of spheres and linear swept spheres, where Vulkan's headers do not have them.
 *
 * They came with VK_NV_ray_tracing_linear_swept_spheres, in version 1.4.307. Beside newer headers this one declares
 * nothing.
 *
 * A geometry of these types has its data in the pNext chain of its VkAccelerationStructureGeometryKHR, whose union is
 * not read:
 *
 *     VkAccelerationStructureGeometryLinearSweptSpheresDataNV strands = {
 *         .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV, ...};
 *     VkAccelerationStructureGeometryKHR geometry = {
 *         .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
 *         .pNext = &strands,
 *         .geometryType = VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV};
 *
 * These structs have no maxVertex: the library reads the indices once to find how many vertices and radii they name,
 * and reads the arrays up to there. docs/library.md says what the fields mean.
 */
#ifndef BVHD_VULKAN_NV_H
#define BVHD_VULKAN_NV_H

#include <vulkan/vulkan_core.h>

#ifndef VK_NV_ray_tracing_linear_swept_spheres

/* The enumerants that these headers lack in enumerations that they have. */
#define VK_GEOMETRY_TYPE_SPHERES_NV ((VkGeometryTypeKHR)1000429004)
#define VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV ((VkGeometryTypeKHR)1000429005)
#define VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV ((VkStructureType)1000429009)
#define VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_SPHERES_DATA_NV ((VkStructureType)1000429010)

/* Which vertices are the two ends of a linear swept sphere. */
typedef enum VkRayTracingLssIndexingModeNV {
    VK_RAY_TRACING_LSS_INDEXING_MODE_LIST_NV = 0, /* two indices each; without indices, two vertices each */
    VK_RAY_TRACING_LSS_INDEXING_MODE_SUCCESSIVE_NV = 1, /* one index each: of the first end, whose successor follows */
    VK_RAY_TRACING_LSS_INDEXING_MODE_MAX_ENUM_NV = 0x7FFFFFFF
} VkRayTracingLssIndexingModeNV;

/* Which ends of linear swept spheres are closed by a part of a sphere. */
typedef enum VkRayTracingLssPrimitiveEndCapsModeNV {
    VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_NONE_NV = 0,
    VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV = 1, /* all but first ends that continue a chain */
    VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_MAX_ENUM_NV = 0x7FFFFFFF
} VkRayTracingLssPrimitiveEndCapsModeNV;

/* A centre and a radius for each vertex, and which of them are spheres. */
typedef struct VkAccelerationStructureGeometrySpheresDataNV {
    VkStructureType sType;
    const void *pNext;
    VkFormat vertexFormat;
    VkDeviceOrHostAddressConstKHR vertexData;
    VkDeviceSize vertexStride;
    VkFormat radiusFormat; /* VK_FORMAT_R32_SFLOAT or VK_FORMAT_R16_SFLOAT */
    VkDeviceOrHostAddressConstKHR radiusData;
    VkDeviceSize radiusStride;
    VkIndexType indexType;
    VkDeviceOrHostAddressConstKHR indexData;
    VkDeviceSize indexStride; /* bytes from one index to the next */
} VkAccelerationStructureGeometrySpheresDataNV;

/* A centre and a radius for each vertex, and which of them are the ends of linear swept spheres. */
typedef struct VkAccelerationStructureGeometryLinearSweptSpheresDataNV {
    VkStructureType sType;
    const void *pNext;
    VkFormat vertexFormat;
    VkDeviceOrHostAddressConstKHR vertexData;
    VkDeviceSize vertexStride;
    VkFormat radiusFormat; /* VK_FORMAT_R32_SFLOAT or VK_FORMAT_R16_SFLOAT */
    VkDeviceOrHostAddressConstKHR radiusData;
    VkDeviceSize radiusStride;
    VkIndexType indexType;
    VkDeviceOrHostAddressConstKHR indexData;
    VkDeviceSize indexStride; /* bytes from one index to the next */
    VkRayTracingLssIndexingModeNV indexingMode;
    VkRayTracingLssPrimitiveEndCapsModeNV endCapsMode;
} VkAccelerationStructureGeometryLinearSweptSpheresDataNV;

#endif

#endif
