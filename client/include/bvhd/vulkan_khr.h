/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_khr.h - Vulkan's structs of VK_KHR_opacity_micromap, where Vulkan's headers do not have them.
 *
 * They came with version 1.4.351. Beside newer headers this one declares nothing.
 *
 * An opacity micromap is a structure of the type VK_ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR. Its one geometry,
 * of the type VK_GEOMETRY_TYPE_MICROMAP_KHR, has its data in the pNext chain of VkAccelerationStructureGeometryKHR:
 *
 *     VkAccelerationStructureGeometryMicromapDataKHR states = {
 *         .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MICROMAP_DATA_KHR, ...};
 *     VkAccelerationStructureGeometryKHR geometry = {
 *         .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
 *         .pNext = &states,
 *         .geometryType = VK_GEOMETRY_TYPE_MICROMAP_KHR};
 *
 * A VkDeviceAddress in these structs is an address of the host, as a number. No range goes with the geometry: the
 * number of triangles is the sum of the counts of usages.
 */
#ifndef BVHD_VULKAN_KHR_H
#define BVHD_VULKAN_KHR_H

#include <vulkan/vulkan_core.h>

#ifdef __cplusplus
extern "C" {
#endif

#ifndef VK_KHR_opacity_micromap

/* The enumerants that these headers lack in enumerations that they have. */
#define VK_ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR ((VkAccelerationStructureTypeKHR)1000623000)
#define VK_GEOMETRY_TYPE_MICROMAP_KHR ((VkGeometryTypeKHR)1000623000)
#define VK_BUILD_ACCELERATION_STRUCTURE_MICROMAP_LOSSY_BIT_KHR ((VkBuildAccelerationStructureFlagBitsKHR)0x400)
#define VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MICROMAP_DATA_KHR ((VkStructureType)1000623002)
#define VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_TRIANGLES_OPACITY_MICROMAP_KHR ((VkStructureType)1000623003)

/* How many states a micro-triangle may have. */
typedef enum VkOpacityMicromapFormatKHR {
    VK_OPACITY_MICROMAP_FORMAT_2_STATE_KHR = 1, /* one bit: transparent, opaque */
    VK_OPACITY_MICROMAP_FORMAT_4_STATE_KHR = 2, /* two bits: those, unknown but transparent, unknown but opaque */
    VK_OPACITY_MICROMAP_FORMAT_MAX_ENUM_KHR = 0x7FFFFFFF
} VkOpacityMicromapFormatKHR;

/* How many triangles of a micromap have this level and this format. */
typedef struct VkMicromapUsageKHR {
    uint32_t count;
    uint32_t subdivisionLevel;
    VkOpacityMicromapFormatKHR format;
} VkMicromapUsageKHR;

/* Where the states of a triangle of a micromap begin in its data, in bytes, and what they are. */
typedef struct VkMicromapTriangleKHR {
    uint32_t dataOffset;
    uint16_t subdivisionLevel;
    uint16_t format;
} VkMicromapTriangleKHR;

/* What a micromap is made of. */
typedef struct VkAccelerationStructureGeometryMicromapDataKHR {
    VkStructureType sType;
    const void *pNext;
    uint32_t usageCountsCount;
    const VkMicromapUsageKHR *pUsageCounts; /* this or ppUsageCounts */
    const VkMicromapUsageKHR *const *ppUsageCounts;
    VkDeviceAddress data;
    VkDeviceAddress triangleArray; /* of VkMicromapTriangleKHR */
    VkDeviceSize triangleArrayStride; /* bytes: 8 or more, a multiple of 4 */
} VkAccelerationStructureGeometryMicromapDataKHR;

/* Which states a geometry's triangles have; in the chain of VkAccelerationStructureGeometryTrianglesDataKHR. */
typedef struct VkAccelerationStructureTrianglesOpacityMicromapKHR {
    VkStructureType sType;
    void *pNext;
    VkIndexType indexType;
    VkDeviceAddress indexBuffer;
    VkDeviceSize indexStride;
    uint32_t baseTriangle;
    VkAccelerationStructureKHR micromap; /* VK_NULL_HANDLE in a build by the host: all indices are special ones */
} VkAccelerationStructureTrianglesOpacityMicromapKHR;

#endif

#ifdef __cplusplus
}
#endif

#endif
